"""Measurements of the time-of-flight pixels: taps, phases, amplitudes, infrared."""

from __future__ import annotations

from functools import lru_cache

import moderngl
import numpy as np
import pytest

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.numpy_twins.tof_decode import CONTRAST_MULTIPLIER, companded
from tests.support.stage_harness import Z_MAX, z_mean, z_sd
from tests.support.tof_harness import QUIET, Camera, Image, merged, quad

#: A crop around the principal point; the window is a little larger.
CROP = Rect(216, 172, 80, 64)
#: The amplitude of a white wall at the centre is GAIN / z^2 (z in m).
GAIN = 1894.0
RAW = {"tof_bilateral": {"enabled": 0.0}, "tof_edge": {"enabled": 0.0}}


@lru_cache(maxsize=1)
def camera(context: moderngl.Context) -> Camera:
    return Camera.open(context)


def phasors(layers: dict[str, Image]) -> np.ndarray:
    """(h, w, 3) complex phasors of the window without its rim."""
    a, b = layers["phasor_a"][8:-8, 8:-8], layers["phasor_b"][8:-8, 8:-8]
    return np.stack(
        [a[..., 0] + 1j * a[..., 1], a[..., 2] + 1j * a[..., 3], b[..., 0] + 1j * b[..., 1]], -1
    )


@pytest.mark.parametrize("z_mm", [900.0, 2500.0])
def test_noise_of_the_taps_has_its_variance(context: moderngl.Context, z_mm: float) -> None:
    cam = camera(context)
    changes = merged(RAW, {"tof_taps": {"companding": 0.0}})
    pure = phasors(cam.shoot([quad(z_mm)], merged(changes, QUIET), crop=CROP))
    wiggle = {"tof_light": {"harmonic_2": 0.0, "harmonic_5": 0.0}}
    for k in range(3):
        amplitude = np.abs(pure[..., k]).mean() / CONTRAST_MULTIPLIER[k]
        sigma = np.sqrt(2 / 3 * (16.5 + 0.0166 * amplitude)) * CONTRAST_MULTIPLIER[k]
        noise = [
            (phasors(cam.shoot([quad(z_mm)], merged(changes, wiggle), seed=s, crop=CROP)) - pure)
            for s in range(6)
        ]
        for part in (np.real(noise)[..., k], np.imag(noise)[..., k]):
            assert abs(z_mean(part)) < Z_MAX
            # The amplitude, and with it sigma, changes by 3 % over the window.
            assert abs(z_sd(part, sigma)) < Z_MAX + 0.01 * np.sqrt(2 * part.size)
        both = np.array([np.real(noise)[..., k].ravel(), np.imag(noise)[..., k].ravel()])
        assert abs(np.corrcoef(both)[0, 1]) < 0.02


def test_companding_is_the_code_of_the_kinect() -> None:
    steps = np.repeat([1, 1, 2, 4, 8, 16, 32, 64], 128)
    table = np.concatenate([[0], np.cumsum(steps)])[:1024].astype(np.float32)
    assert table[-1] == 16320
    np.testing.assert_array_equal(companded(table), table)
    np.testing.assert_array_equal(companded(-table), -table)
    taps = np.random.default_rng(0).uniform(-17000, 17000, 20000).astype(np.float32)
    nearest = table[np.abs(np.abs(taps)[:, None] - table).argmin(axis=1)]
    error = np.abs(np.abs(companded(taps)) - np.minimum(np.abs(taps), 16320))
    assert (error <= np.abs(nearest - np.minimum(np.abs(taps), 16320)) + 1e-3).all()


def test_light_spreads_as_measured(context: moderngl.Context) -> None:
    """A bright strip: the share of its light in the columns beside it, by halo and haze."""
    cam = camera(context)
    half = 1.5 * 900 / 365.456  # three columns, less what the rims miss
    scene = [quad(900.0, (-half, half)), quad(930.0, albedo=0.0)]
    spread = {"tof_taps": {"halo": 0.1, "haze": 0.0, "psf_sigma_px": 0.22}}
    sharp = {"tof_taps": {"halo": 0.0, "haze": 0.0, "psf_sigma_px": 0.0}}
    row, core = (
        np.abs(phasors(cam.shoot(scene, merged(RAW, QUIET, change))))[200, :, 1].astype(float)
        for change in (spread, sharp)
    )
    assert row.sum() == pytest.approx(core.sum(), rel=1e-3)
    centre = (np.arange(len(core)) * core).sum() / core.sum()
    variance = [((np.arange(len(v)) - centre) ** 2 * v).sum() / v.sum() for v in (row, core)]
    # A core of 0.22 px, and a halo whose variance along an axis is 0.30 + 0.71 px^2.
    assert variance[0] - variance[1] == pytest.approx(0.9 * 0.22**2 + 0.1 * 1.09, rel=0.1)


def test_much_light_saturates(context: moderngl.Context) -> None:
    cam = camera(context)
    layers = cam.shoot([quad(900)], {"tof_taps": {"saturation_lsb": 300.0}}, crop=CROP)
    inner = layers["reason"][8:-8, 8:-8]
    assert (inner == Reason.SATURATED).all()
    assert (layers["infrared"][8:-8, 8:-8] == 65535).all()
    assert not layers["depth"][8:-8, 8:-8].any()
