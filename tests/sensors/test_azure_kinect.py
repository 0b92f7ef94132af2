"""The Azure Kinect against its one real frame: shadows, infrared and noise over infrared."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.geometry.rect import Rect
from tests.support.tof_harness import QUIET, Camera, quad

#: pyk4a's test recording (MIT): a mug at 0.2 to 0.3 m before a wall at 1.5 to 2 m.
REAL = Path(__file__).resolve().parents[3] / "shared/data/real-cameras/azure_kinect_mug"
#: Limits of the bins of infrared, counts, in which noise is compared.
COUNTS = (60, 100, 150, 200, 300, 500, 1000, 3000, 9000)
SIDE = 12


def measured_law(counts: float) -> float:
    """Return the plane residual of the real frame over infrared, mm (fit, within 12 %)."""
    return float(np.hypot(0.42, 84 / counts**0.75))


def plane_residuals(
    depth_mm: NDArray[np.floating], infrared: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return (N, 2): median infrared, and RMS residual of the plane, mm, of tiles with depth."""
    y, x = np.indices((SIDE, SIDE)) - (SIDE - 1) / 2
    base = np.column_stack([x.ravel(), y.ravel(), np.ones(SIDE**2)])
    fit = np.linalg.pinv(base)
    rows = []
    for top in range(0, depth_mm.shape[0] - SIDE, SIDE // 2):
        for left in range(0, depth_mm.shape[1] - SIDE, SIDE // 2):
            tile = np.s_[top : top + SIDE, left : left + SIDE]
            z = depth_mm[tile].astype(float).ravel()
            if z.min() > 0 and np.ptp(z) <= 60:  # no edges
                rms = np.sqrt(((z - base @ (fit @ z)) ** 2).sum() / (SIDE**2 - 3))
                rows.append((np.median(infrared[tile]), rms))
    return np.array(rows)


def medians(rows: NDArray[np.float64]) -> list[tuple[float, float, int]]:
    """Return infrared, median residual, mm, and number of tiles of each bin of COUNTS."""
    bins = []
    for low, high in pairwise(COUNTS):
        inside = rows[(rows[:, 0] >= low) & (rows[:, 0] < high)]
        bins.append((*(np.median(inside, axis=0) if len(inside) else (0, 0)), len(inside)))
    return bins


def simulated_residuals(context: moderngl.Context) -> NDArray[np.float64]:
    cam = Camera.open(context, "azure-kinect")
    rows = []
    for seed, (z_m, albedo) in enumerate(
        (z, a) for z in (0.3, 0.5, 0.8, 1.2, 1.6, 2.0) for a in (0.05, 0.1, 0.2, 0.4, 0.8)
    ):
        crop = Rect(240, 240, 160, 160)
        shot = cam.shoot([quad(1000 * z_m, albedo=albedo)], {}, seed=seed, crop=crop)
        rows.append(plane_residuals(np.round(1000 * shot["depth"]), shot["infrared"]))
    return np.concatenate([r for r in rows if len(r)])


def test_noise_over_infrared_follows_the_measured_law(context: moderngl.Context) -> None:
    for counts, residual_mm, tiles in medians(simulated_residuals(context)):
        assert tiles > 100, counts
        assert residual_mm == pytest.approx(measured_law(counts), rel=0.15), counts


def test_noise_over_infrared_is_that_of_the_real_frame(context: moderngl.Context) -> None:
    if not REAL.is_dir():
        pytest.skip(f"no real frame of an Azure Kinect at {REAL}")
    depth, infrared = (cv2.imread(str(REAL / f), -1) for f in ("depth.png", "infrared.png"))
    assert depth is not None
    assert infrared is not None
    real = medians(plane_residuals(depth.astype(float), infrared.astype(float)))
    ours = medians(simulated_residuals(context))
    for (counts, expected_mm, tiles), (_, residual_mm, _) in zip(real, ours, strict=True):
        assert tiles > 100, counts
        # The real tiles hold wallpaper and a curved mug, and are spread over a bin in another way.
        assert residual_mm == pytest.approx(expected_mm, rel=0.3), counts


def test_temporal_sigma_agrees_with_the_published_one(context: moderngl.Context) -> None:
    """Tolgyessy et al. 2021: 0.89, 1.78 mm at 1.5, 3 m (from memory), on a white wall.

    Nothing was fitted to it. Their 0.61 mm at 0.8 m lies above ours: the distance where the noise
    of one frame, of which one cannot tell what stays, is smallest.
    """
    cam = Camera.open(context, "azure-kinect")
    crop = Rect(280, 280, 80, 80)
    for z_mm, expected_mm in ((1500.0, 0.89), (3000.0, 1.78)):
        wall = [quad(z_mm, albedo=0.8)]
        shots = np.stack([cam.shoot(wall, {}, seed=s, crop=crop)["depth"] for s in range(10)])
        sigma_mm = 1000 * np.sqrt(shots[:, 12:-12, 12:-12].var(axis=0, ddof=1).mean())
        assert sigma_mm == pytest.approx(expected_mm, rel=0.25), z_mm


def test_a_shadow_falls_where_the_real_mugs_handle_has_its(context: moderngl.Context) -> None:
    """A bar at 0.297 m before a wall at 1.52 m: its shadow is moved by 19 +-1 px to the right."""
    cam = Camera.open(context, "azure-kinect")
    bar = quad(297.0, x_mm=(-10.0, 10.0), albedo=0.3)
    row = {n: layer[332] for n, layer in cam.shoot([quad(1520.0, albedo=0.8), bar], QUIET).items()}
    seen = np.flatnonzero((row["clean"] > 0) & (row["clean"] < 1.0))
    shadow = np.flatnonzero((row["clean"] > 1.0) & (row["lit"] < 0.5))
    assert shadow.min() == seen.max() + 1  # to the right of the bar, and without a gap
    assert shadow.max() - seen.max() == pytest.approx(19, abs=1)
    penumbra = (row["lit"] > 0.0) & (row["lit"] < 1.0) & (row["clean"] > 1.0)
    assert 2 <= penumbra.sum() <= 8  # measured: 5 px


def test_infrared_and_limits_are_those_of_the_real_frame(context: moderngl.Context) -> None:
    cam = Camera.open(context, "azure-kinect")
    wall = cam.shoot([quad(1500.0, albedo=0.8)], QUIET)
    counts = wall["infrared"][332, 320] * 1.5**2
    assert counts == pytest.approx(1450, rel=0.05)  # white walls: 1,300 to 1,500
    near = cam.shoot([quad(170.0, albedo=0.2)], QUIET)
    assert near["depth"][332, 320] == pytest.approx(0.17, abs=0.001)  # nearest real depth: 165 mm
    bright = cam.shoot([quad(250.0, albedo=0.8)], QUIET)
    assert bright["depth"][332, 320] == 0
    assert bright["infrared"][332, 320] == 65535
    dark = cam.shoot([quad(2000.0, albedo=0.08)], QUIET)  # 36 counts; the darkest real pixels: 43
    assert (dark["depth"][300:360, 300:340] == 0).all()
