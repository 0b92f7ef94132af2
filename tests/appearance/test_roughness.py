"""Hair is rough to a depth camera, as on real heads, and skin stays as it was."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.frame import Frame
from glsim.measures.frame import frame_set
from glsim.measures.spatial import measure_spatial
from glsim.pipeline import simulate
from glsim.settings.schema import load_settings
from tests.support.wardrobe import heads


def residual_mm(context: moderngl.Context, wear: str) -> tuple[float, float, float]:
    """p10, median and p90 of what a quadric leaves in 7 x 7 pixels of a Kinect V2's noisy heads."""
    tree = {
        "sensor": "kinect-v2",
        "source": {"subjects": 10, "frames_per_subject": 1},
        "pose": {"distance_mm": {"uniform": [800, 1350]}, "yaw_deg": {"uniform": [-30, 30]}},
        "appearance": {"wear": wear, "hair": 1},
    }
    made = simulate(load_settings(overrides=tree), sources=[heads()], context=context)
    depth = []
    for frame in made:
        assert isinstance(frame, Frame)
        whole = np.zeros((424, 512), np.float32)
        whole[frame.window.slices] = frame.noisy_m * 1000
        depth.append(whole)
    return measure_spatial(frame_set(wear, depth).frames).rough_mm


@pytest.mark.long
def test_dressed_heads_are_as_rough_as_real_ones(context: moderngl.Context) -> None:
    """Real heads with hair: p90 2.9 mm in 44 frames of a Kinect V2, 1.16 mm in the median."""
    bare, dressed = (residual_mm(context, wear) for wear in ("never", "always"))
    assert 2.0 < dressed[2] < 3.5
    assert dressed[2] > bare[2] + 0.4
    assert abs(dressed[0] - bare[0]) < 0.15  # the smoothest tenth is skin in both
