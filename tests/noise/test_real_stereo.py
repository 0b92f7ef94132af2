"""Frames of a real D435 against the rules of any-depth-camera and of librealsense's filters."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.geometry.rect import Rect
from glsim.noise.numpy_twins.lattice import lattice_noise
from tests.support.stage_harness import WHOLE, Image, frame, layers_of, run_twin

REAL = Path(__file__).resolve().parents[3] / "shared/data/real-cameras/d435_wall_2frames"

pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason="needs two frames of a static wall by a D435 in shared/data"
)

#: Focal length times baseline, px mm. Measured: K / n fits every value for K from 626,822.5 to
#: 626,823.0 mm; the recording's file has 390.4315 px and 50.1707 mm, 626,823.1 / 32.
FOCAL_BASELINE_PX_MM = 626822.75 / 32
TILE_PX = 40
LAGS = [1, 2, 3, 4, 6, 8, 12]


@pytest.fixture(scope="module")
def depths_mm() -> list[NDArray[np.float64]]:
    """The two frames; 0 = hole."""
    files = [REAL / f"depth_{n}.png" for n in (0, 1)]
    return [cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.float64) for file in files]


def disparity_steps(depth_mm: NDArray[np.float64]) -> Image:
    """Disparity in 1/32 px; 0 = hole."""
    constant = 32 * FOCAL_BASELINE_PX_MM
    known = np.where(depth_mm > 0, depth_mm, 1.0)
    return np.where(depth_mm > 0, constant / known, 0.0).astype(np.float32)


def residuals(image: Image, valid: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """What a plane leaves in tiles that are a plane; 0 at the few holes."""
    y, x = np.mgrid[:TILE_PX, :TILE_PX] - TILE_PX / 2
    plane = np.stack([x, y, np.ones_like(x)], axis=-1)
    for top in range(0, image.shape[0] - TILE_PX + 1, TILE_PX):
        for left in range(0, image.shape[1] - TILE_PX + 1, TILE_PX):
            part = np.s_[top : top + TILE_PX, left : left + TILE_PX]
            here = valid[part]
            if here.mean() < 0.97:
                continue
            values = image[part].astype(np.float64)
            fit = np.linalg.lstsq(plane[here], values[here], rcond=None)[0]
            rest = np.where(here, values - plane @ fit, 0.0)
            if rest.std() < 0.2 * 32:  # tiles with an edge have more than 0.2 px
                yield rest


def correlations(tiles: list[NDArray[np.float64]], axis: int) -> NDArray[np.float64]:
    """The mean correlation along an axis at LAGS."""
    variance = np.mean([np.mean(tile**2) for tile in tiles])

    def product(tile: NDArray[np.float64], lag: int) -> float:
        ahead = np.take(tile, range(lag, TILE_PX), axis)
        behind = np.take(tile, range(TILE_PX - lag), axis)
        return float(np.mean(ahead * behind))

    return np.array([np.mean([product(t, lag) for t in tiles]) / variance for lag in LAGS])


def test_real_depth_is_on_the_lattice_that_is_drawn(
    depths_mm: list[NDArray[np.float64]],
) -> None:
    """Every value of the D435 is one that any_camera_losses makes with its f B and 1/32 px."""
    ramp = frame(width=20000, height=1, window=Rect(0, 0, 20000, 1))
    depth = np.linspace(0.3, 2.2, 20000)[None, :]
    layers = layers_of(depth, np.array([0.0, 0.0, -1.0, 0.0]), ramp)
    p = {"single_share": 0.0, "cluster_share": 0.0, "dark_signal": 0.0, "saturated_signal": 1e6}
    drawn = run_twin(
        "any_camera_losses", layers, ramp, **p, grazing_cosine=0.0, grazing_spread=0.0,
        step_px=1 / 32, focal_baseline_px_mm=FOCAL_BASELINE_PX_MM,
    )["depth"]  # fmt: skip
    made = np.unique(
        np.rint(1000 * run_twin("millimetre_quantise", {"depth": drawn}, ramp)["depth"])
    )
    real = np.unique(depths_mm[0])
    real = real[(real > 310) & (real < 2190)]
    assert len(real) > 800
    assert np.isin(real, made).all(), real[~np.isin(real, made)]
    assert len(made) < 1600  # the ramp has 1900 whole millimetres


def test_real_noise_has_the_correlation_of_the_widest_lattice(
    depths_mm: list[NDArray[np.float64]],
) -> None:
    """Of the plane's residual, and of what changes between two frames."""
    steps = [disparity_steps(depth) for depth in depths_mm]
    both = (depths_mm[0] > 0) & (depths_mm[1] > 0)
    lattice = [
        np.sqrt(0.95) * lattice_noise(WHOLE, (np.float32(8), np.float32(8)), seed)
        + np.sqrt(0.05) * np.random.default_rng(seed).standard_normal((212, 256))
        for seed in range(12)
    ]
    for image, valid in ((steps[0], depths_mm[0] > 0), (steps[1] - steps[0], both)):
        tiles = list(residuals(image, valid))
        assert len(tiles) > 20
        whole = np.ones((212, 256), bool)
        ours = [t for field in lattice for t in residuals(field.astype(np.float32), whole)]
        for axis in (0, 1):
            off = correlations(tiles, axis) - correlations(ours, axis)
            assert np.abs(off).mean() < 0.1, off
            assert np.abs(off).max() < 0.2, off
