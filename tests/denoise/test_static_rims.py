"""Rims of static views: the network departs from the sensor's mean there, towards the truth."""

from __future__ import annotations

import moderngl
import pytest

from benchmarks.static_rims import head_before_wall, rings
from glsim.denoise import MapDenoiser, load
from glsim.validate.virtual_camera import VirtualCamera


@pytest.mark.long
def test_rims_of_a_head_before_a_wall_come_nearer_to_the_truth(context: moderngl.Context) -> None:
    """Microsoft's decoder, 1 m: what looks like harm against the mean of the frames is none."""
    camera = VirtualCamera("kinect-v2-sdk", context, seed=3)
    capture = camera.capture(
        head_before_wall(1000, 300), 12, None, at_mm=(0.0, 0.0, 1000.0), scene="head"
    )
    rim, beside, surface = rings(capture, MapDenoiser(load("face")))
    assert rim.pixels > 2000
    assert rim.raw_truth > 2 * rim.raw_mean  # the sensor's mean is off
    assert rim.denoised_truth < 0.8 * rim.raw_truth
    for ring in (beside, surface):
        assert ring.pixels > 2000
        assert ring.denoised_truth < 0.8 * ring.raw_truth
        assert ring.denoised_mean < 0.8 * ring.raw_mean
