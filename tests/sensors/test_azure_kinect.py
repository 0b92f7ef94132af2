"""The Azure Kinect against its one real frame: shadows, infrared and noise over infrared."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.bench.validate.checks.azure_kinect import (
    WIDE_PX,
    dim_correlation,
    noise_by_infrared,
    plane_tiles,
    rim_measurements,
)
from glsim.bench.validate.run import sheets
from glsim.core.rect import Rect
from tests.support.tof_harness import QUIET, Camera, quad

#: pyk4a's test recording (MIT): a mug at 0.2 to 0.3 m before a wall at 1.5 to 2 m.
REAL = Path(__file__).resolve().parents[3] / "shared/data/real-cameras/azure_kinect_mug"


def real_frame() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return depth, mm, and infrared of the real frame; skip where it is absent."""
    if not REAL.is_dir():
        pytest.skip(f"no real frame of an Azure Kinect at {REAL}")
    depth, infrared = (cv2.imread(str(REAL / f), -1) for f in ("depth.png", "infrared.png"))
    return depth.astype(np.float64), infrared.astype(np.float64)


def test_the_law_of_noise_over_infrared_is_that_of_the_real_frame() -> None:
    depth, infrared = real_frame()
    counts, rms_mm, _ = plane_tiles(depth, infrared)
    for name, share in noise_by_infrared(counts, rms_mm).items():
        assert share == pytest.approx(1.0, rel=0.15), name


def test_the_sheets_bands_hold_the_real_frame() -> None:
    """The same code as on simulated frames, so that no band is one of the simulator alone."""
    depth, infrared = real_frame()
    checks = {check.number: check for check in sheets()["azure-kinect"].checks}
    for number, measured in rim_measurements(depth).items():
        for band in checks[number].bands:
            value = measured.values[band.key]
            assert value is not None
            assert band.holds(value), (number, band.key, value)
    counts, _, residual_mm = plane_tiles(depth, infrared, WIDE_PX)
    found = dim_correlation(counts, residual_mm)
    for band in checks["2"].bands:
        assert found[band.key] == pytest.approx(0.5 * (band.low + band.high), abs=0.006), band.key


def test_the_field_stop_is_the_real_hexagon(context: Context) -> None:
    """In the raw image, with the real device's principal point."""
    _, infrared = real_frame()
    cam = Camera.open(context, "azure-kinect", deliver="raw", centre_px=[333.3, 349.3])
    ours = cam.shoot([quad(1000.0, albedo=0.8)], QUIET)["infrared"] > 0
    apart = ours != (infrared > 0)
    assert ours.mean() == pytest.approx((infrared > 0).mean(), abs=0.005)
    assert apart.mean() < 0.015


@pytest.mark.parametrize(
    ("sensor", "size", "far_m", "share"),
    [
        ("azure-kinect-nfov-binned", (320, 288), 5.46, (0.75, 1.0)),
        ("azure-kinect-wfov", (512, 512), 2.88, (0.6, 0.79)),
        ("azure-kinect-wfov-unbinned", (1024, 1024), 2.21, (0.6, 0.79)),
        ("femto-bolt", (640, 576), 3.86, (0.75, 1.0)),
    ],
)
@pytest.mark.long
def test_modes_see_their_part_of_the_chip_to_their_range(
    context: Context, sensor: str, size: tuple[int, int], far_m: float, share: tuple[float, float]
) -> None:
    cam = Camera.open(context, sensor)
    image = cam.sensor.rig.intrinsics
    assert (image.width, image.height) == size
    albedo = 0.6 if size == (320, 288) else 0.95  # the sum of four pixels is bright enough
    crop = Rect(image.width // 2 - 40, image.height // 2 - 40, 80, 80)
    inside = cam.shoot([quad(1000 * far_m - 60, albedo=albedo)], crop=crop)["depth"][30:50, 30:50]
    beyond = cam.shoot([quad(1000 * far_m + 100, albedo=0.95)], crop=crop)["depth"]
    assert (inside > 0).mean() > 0.8
    assert (beyond > 0).mean() < 0.02
    lit = cam.shoot([quad(600.0, albedo=0.8)], QUIET)["infrared"] > 0
    assert share[0] <= lit.mean() <= share[1]  # the circle has pi / 4 of its square


def test_light_of_many_ways_loses_contrast_at_fast_frequencies(context: Context) -> None:
    cam = Camera.open(context, "azure-kinect")
    bar = quad(297.0, x_mm=(-10.0, 10.0), albedo=0.3)
    scene = [quad(1520.0, albedo=0.8), bar]
    plain = cam.shoot(scene, {**QUIET, "tof_light": {"indirect_spread_mm": 0.0}})
    many = cam.shoot(scene, {**QUIET, "tof_light": {"indirect_spread_mm": 90.0}})
    shadow = (plain["clean"] > 1.0) & (plain["lit"] == 0.0)
    assert (plain["depth"][shadow] > 0).mean() > (many["depth"][shadow] > 0).mean() + 0.15
    lit = plain["lit"] == 1.0
    assert np.array_equal(plain["infrared"][lit][:100], many["infrared"][lit][:100])


def test_temporal_sigma_agrees_with_the_published_one(context: Context) -> None:
    """Tolgyessy et al. 2021: 0.89, 1.78 mm at 1.5, 3 m (from memory), on a white wall.

    Nothing was fitted to it; ours at 3 m are 2.4 mm, which the real frame's residuals demand. Their
    0.61 mm at 0.8 m lies above ours: the distance where the noise of one frame, of which one cannot
    tell what stays, is smallest.
    """
    cam = Camera.open(context, "azure-kinect")
    crop = Rect(280, 280, 80, 80)
    for z_mm, expected_mm in ((1500.0, 0.89), (3000.0, 1.78)):
        wall = [quad(z_mm, albedo=0.8)]
        shots = np.stack([cam.shoot(wall, {}, seed=s, crop=crop)["depth"] for s in range(10)])
        shots = np.where(shots > 0, shots, np.nan)[:, 12:-12, 12:-12]
        sigma_mm = 1000 * np.sqrt(np.nanvar(shots, axis=0, ddof=1).mean())
        assert sigma_mm == pytest.approx(expected_mm, rel=0.35), z_mm
