"""Noise of a device and of a frame: fixed pattern, floor, wiggling, rounding, whiteness."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.core.rect import Rect
from tests.support.stage_harness import Z_MAX, z_mean
from tests.support.tof_harness import QUIET, Camera, Image, merged, quad

CROP = Rect(215, 165, 80, 80)
EXACT = {"millimetre_quantise": {"enabled": 0.0}}
SENSORS = ["kinect-v2", "kinect-v2-fast"]


def walls(
    cam: Camera,
    frames: int,
    changes: dict[str, dict[str, float]],
    z_mm: float = 900.0,
    device: int = 5,
) -> Image:
    """(frames, h, w) mm without the rim of the window."""
    shots = [
        cam.shoot([quad(z_mm)], changes, seed=seed, device=device, crop=CROP)["depth"]
        for seed in range(frames)
    ]
    return 1000 * np.stack(shots)[:, 12:-12, 12:-12]


def test_floor_alone_has_its_sigma(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    for sigma in (0.5, 1.1):
        changes = merged(QUIET, {"tof_floor": {"enabled": 1.0, "sigma_mm": sigma}})
        noise = walls(cam, 12, changes) - 900.0
        # Neighbours are alike: every third pixel of every third row is independent.
        independent = noise[:, ::3, ::3]
        assert abs(z_mean(independent)) < Z_MAX
        assert independent.std() == pytest.approx(sigma, rel=0.03)


def test_floor_grows_with_the_slope(context: moderngl.Context) -> None:
    """A tenth of a pixel of 2.5 mm, times the tangent."""
    cam = Camera.open(context)
    changes = merged(QUIET, {"tof_floor": {"enabled": 1.0, "sigma_mm": 0.0}})
    scene = [quad(900.0, (-300, 300), (-300, 300), yaw_deg=60)]
    shots = [cam.shoot(scene, changes, seed=seed, crop=CROP)["depth"] for seed in range(12)]
    noise = 1000 * np.stack(shots)[:, 40:60, 40:60]
    sigma = np.sqrt(noise.var(axis=0, ddof=1).mean())
    assert sigma == pytest.approx(0.1 * 900 / 365.456 * np.tan(np.radians(60)), rel=0.1)


@pytest.mark.parametrize("phases", [0.0, 1.0])
def test_wiggling_has_the_periods_of_three_taps(context: moderngl.Context, phases: float) -> None:
    """Thirds and sixths of the half waves: 417, 625, 3125 and 208, 312, 1562 mm; 468 mm is not."""
    cam = Camera.open(context)
    changes = merged(QUIET, {"tof_light": {"harmonic_2": 0.01, "harmonic_5": 0.003,
                                           "harmonic_phase_spread": phases}})  # fmt: skip
    z = np.arange(600.0, 3000.0, 30.0)
    small = Rect(250, 200, 12, 12)
    error = []
    for z_mm in z:
        depth = cam.shoot([quad(z_mm, albedo=0.5)], changes, crop=small)["depth"]
        error.append(1000 * depth[8:-8, 8:-8].mean() - z_mm)
    curve = np.array(error)
    periods = (3125.0, 1562.5, 625.0, 416.7, 312.5, 208.3, 468.75)
    basis = [f(2 * np.pi * z / p) for p in periods for f in (np.cos, np.sin)]
    fit = np.linalg.lstsq(np.array([np.ones_like(z), *basis]).T, curve, rcond=None)[0]
    size = np.hypot(fit[1::2], fit[2::2])
    np.testing.assert_allclose(size[[0, 2, 3]], 1.1, atol=0.15)
    np.testing.assert_allclose(size[[1, 4, 5]], 0.33, atol=0.1)
    assert size[6] < 0.06
    assert (
        (1.5 if phases == 0 else 0.8)
        < np.abs(curve - np.polyval(np.polyfit(z, curve, 1), z)).max()
        < 8
    )


@pytest.mark.parametrize("z_mm", [900.0, 2000.0, 4000.0])
def test_the_fast_sensor_is_as_noisy(context: moderngl.Context, z_mm: float) -> None:
    sigmas = [
        np.sqrt(walls(Camera.open(context, name), 12, EXACT, z_mm).var(axis=0, ddof=1).mean())
        for name in SENSORS
    ]
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.05)
