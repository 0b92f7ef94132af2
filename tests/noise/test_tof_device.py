"""Noise of a device and of a frame: fixed pattern, floor, wiggling, rounding, whiteness."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.geometry.rect import Rect
from tests.support.stage_harness import Z_MAX, z_mean
from tests.support.tof_harness import QUIET, Camera, Image, merged, quad, residual_mm

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


@pytest.mark.parametrize("sensor", SENSORS)
def test_fixed_pattern_is_the_devices(context: moderngl.Context, sensor: str) -> None:
    cam = Camera.open(context, sensor)
    shots = walls(cam, 60, EXACT)
    mean = residual_mm(shots.mean(axis=0) / 1000)
    temporal = np.sqrt(shots.var(axis=0, ddof=1).mean())
    fixed = np.sqrt(mean.var() - temporal**2 / 60)
    assert 0.3 < fixed < 1.2
    assert 1.0 < temporal < 1.3
    spatial = np.mean([residual_mm(shot / 1000).std() for shot in shots[:8]])
    assert np.hypot(fixed, temporal) == pytest.approx(spatial, rel=0.05)
    halves = [residual_mm(part.mean(axis=0) / 1000) for part in (shots[:30], shots[30:])]
    assert np.corrcoef(halves[0].ravel(), halves[1].ravel())[0, 1] > 0.8
    other = residual_mm(walls(cam, 20, EXACT, device=6).mean(axis=0) / 1000)
    assert (
        abs(np.corrcoef(mean.ravel(), other.ravel())[0, 1]) < 0.9
    )  # rows alternate in all, with changing sign


def test_noise_is_new_in_every_frame(context: moderngl.Context) -> None:
    """White in time, and normal."""
    noise = walls(Camera.open(context), 50, EXACT)
    noise = noise - noise.mean(axis=0)
    sigma = noise.std()
    assert abs((noise[1:] * noise[:-1]).mean() / sigma**2 + 1 / 50) < 0.02
    assert abs((noise**3).mean() / sigma**3) < 0.1
    assert abs((noise**4).mean() / sigma**4 - 3) < 0.2


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


def test_depth_is_whole_millimetres(context: moderngl.Context) -> None:
    shots = walls(Camera.open(context), 2, {}, 2987.0)
    np.testing.assert_allclose(shots, np.rint(shots), atol=3e-4)
    ramp = walls(Camera.open(context), 1, QUIET, 3000.0)
    assert np.abs(ramp - 3000).max() < 0.05


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


def test_phases_of_the_wiggling_are_the_devices(context: moderngl.Context) -> None:
    """Another device errs otherwise at the same distance; negative amplitudes turn the error."""
    cam, small = Camera.open(context), Rect(250, 200, 12, 12)

    def error_mm(device: int, **light: float) -> float:
        changes = merged(QUIET, {"tof_light": {"harmonic_2": 0.01, **light}})
        shot = cam.shoot([quad(900.0, albedo=0.5)], changes, crop=small, device=device)
        return float(1000 * shot["depth"][8:-8, 8:-8].mean() - 900)

    errors = np.array([error_mm(device) for device in range(40)])
    # Three sines of 1.1 mm with random phases: sigma 1.1 sqrt(3 / 2).
    assert errors.std(ddof=1) == pytest.approx(1.1 * np.sqrt(1.5), rel=0.35)
    assert abs(errors.mean()) < 3 * 1.35 / np.sqrt(40)
    assert error_mm(3, harmonic_2=-0.01) == pytest.approx(-error_mm(3), abs=0.1)
    turned = error_mm(3, harmonic_phase_spread=0.0, harmonic_2_phase_deg=180.0)
    assert turned == pytest.approx(-error_mm(3, harmonic_phase_spread=0.0), abs=0.1)


def test_offsets_are_constant(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    for name, by_mm in (("offset_mm", 20.0), ("subsurface_mm", 7.0)):
        found = walls(cam, 1, merged(QUIET, {"tof_light": {name: by_mm}}))
        assert found.mean() - 900.0 == pytest.approx(by_mm, abs=0.12)  # along the ray


def test_it_is_darker_and_noisier_in_the_corner(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    scene = [quad(1500.0)]
    shots = np.stack([1000 * cam.shoot(scene, EXACT, seed=s)["depth"] for s in range(6)])
    sigma = shots.std(axis=0, ddof=1)
    middle, corner = sigma[190:230, 240:280], sigma[2:30, 2:30]
    assert (shots[:, 2:30, 2:30] > 0).mean() > 0.9
    assert 2.5 < np.median(corner) / np.median(middle) < 8  # a tenth of the light is left
    rim = sigma[200:224, 315:325]  # of a face: 0.18 from the axis
    assert 0.85 < np.median(rim) / np.median(middle) < 1.25


@pytest.mark.parametrize("z_mm", [900.0, 2000.0, 4000.0])
def test_the_fast_sensor_is_as_noisy(context: moderngl.Context, z_mm: float) -> None:
    sigmas = [
        np.sqrt(walls(Camera.open(context, name), 12, EXACT, z_mm).var(axis=0, ddof=1).mean())
        for name in SENSORS
    ]
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.05)


def test_light_over_the_image_is_that_of_real_frames(context: moderngl.Context) -> None:
    """Infrared of white surfaces times distance^2 over cosine: .88 at 170 px, .59 at 190 px."""
    cam = Camera.open(context)
    layers = cam.shoot([quad(1500.0, albedo=0.8)], QUIET)
    y, x = np.indices(layers["infrared"].shape)
    tangent = np.hypot(x - 254.878, y - 205.395) / 365.456
    # Square of the distance over the cosine, of a wall across the axis.
    light = layers["infrared"] * (1 + tangent**2) ** 1.5 * 1.5**2 / 0.8

    def at(radius_px: float) -> float:
        ring = np.abs(tangent * 365.456 - radius_px) < 2
        return float(np.median(light[ring]) / np.median(light[tangent < 0.1]))

    assert np.median(light[tangent < 0.1]) == pytest.approx(30_300, rel=0.01)
    for radius_px, expected in ((80, 1.0), (120, 1.0), (155, 1.0), (170, 0.88), (190, 0.59)):
        assert at(radius_px) == pytest.approx(expected, abs=0.06), radius_px
    assert 0.05 < at(300) < 0.2  # noise beyond 250 px at 1.36 m is 3.9 mm
