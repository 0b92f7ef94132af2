"""Noise of disparity: exact on planted noise, and the known figures on frames of real cameras."""

import numpy as np
import pytest

from glsim.measures.disparity import LAGS_PX, find_tiles, measure_disparity_noise
from tests.support.real_cameras import (
    D435_WALL_PX_MM,
    SIDE_PX,
    box_covariance,
    box_noise,
    needs_real_cameras,
    real_disparities,
)

SHAPE = (400, 640)


def _plane() -> np.ndarray:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return 20.0 + 0.01 * columns - 0.02 * rows


def test_white_noise_of_a_slanted_plane_has_its_sigma_and_no_correlation() -> None:
    frames = _plane() + np.random.default_rng(1).normal(0, 0.1, (3, *SHAPE))
    noise = measure_disparity_noise(list(frames), [(0, 1), (1, 2)])
    assert noise.tiles == 3 * 160
    assert noise.residual == pytest.approx(0.1, rel=0.01)
    assert noise.frame == pytest.approx(0.1, rel=0.01)
    assert noise.static < 0.01
    assert np.abs([noise.rows, noise.columns, noise.frame_rows, noise.frame_columns]).max() < 0.02


@pytest.mark.parametrize("box_px", [5, 13])
def test_noise_of_a_box_is_what_the_plane_of_a_tile_leaves_of_it(box_px: int) -> None:
    """Expected values by the covariance of a box, minus a plane, exactly."""
    frames = _plane() + box_noise(np.random.default_rng(2), 6, SHAPE, box_px, 0.1)
    tiles = [find_tiles(frame) for frame in frames]
    rms = np.sqrt(np.mean([np.mean(t.sigma**2) for t in tiles]))
    left = box_covariance(SIDE_PX, box_px)
    assert rms == pytest.approx(0.1 * np.sqrt(np.trace(left) / (SIDE_PX**2 - 3)), rel=0.03)
    noise = measure_disparity_noise(list(frames))
    place = np.arange(SIDE_PX**2).reshape(SIDE_PX, SIDE_PX)
    spread = np.diag(left)
    for lag, found in zip(LAGS_PX, noise.rows, strict=True):
        a, b = place[:, :-lag].ravel(), place[:, lag:].ravel()
        expected = left[a, b].sum() / (0.5 * (spread[a] + spread[b]).sum())
        assert found == pytest.approx(expected, abs=0.05)  # the mean of ratios, not of sums


def test_noise_splits_into_what_stays_and_what_changes() -> None:
    rng = np.random.default_rng(3)
    stays = box_noise(rng, 1, SHAPE, 5, 0.07)
    changes = box_noise(rng, 5, SHAPE, 5, 0.09)
    frames = list(_plane() + stays + changes)
    noise = measure_disparity_noise(frames, [(k, k + 1) for k in range(4)])
    lost = np.sqrt(np.trace(box_covariance(SIDE_PX, 5)) / (SIDE_PX**2 - 3))
    assert noise.static == pytest.approx(0.07 * lost, rel=0.05)
    assert noise.residual == pytest.approx(np.hypot(0.07, 0.09) * lost, rel=0.05)
    assert noise.frame == pytest.approx(0.09, rel=0.06)
    assert noise.frame_rows[:3] == pytest.approx((0.8, 0.6, 0.4), abs=0.03)
    assert noise.frame_columns[:3] == pytest.approx((0.8, 0.6, 0.4), abs=0.03)


def test_outliers_and_small_holes_do_not_count_and_large_holes_leave_tiles_out() -> None:
    rng = np.random.default_rng(4)
    frame = _plane() + rng.normal(0, 0.1, SHAPE)
    wild = rng.random(SHAPE) < 0.01
    frame[wild] += 8.0
    frame[rng.random(SHAPE) < 0.01] = np.nan
    frame[:80, :80] = np.nan
    noise = measure_disparity_noise([frame])
    assert noise.tiles == 160 - 4
    assert noise.residual == pytest.approx(0.1, rel=0.02)


def test_a_plane_on_a_coarse_lattice_is_rounding_and_no_outlier() -> None:
    """Half of the deviations may be 0 there."""
    frame = np.round(_plane())
    assert measure_disparity_noise([frame]).residual == pytest.approx(12**-0.5, rel=0.1)


@needs_real_cameras
def test_a_d435_of_a_wall() -> None:
    """Known: 0.106 to 0.125 px, frame to frame 0.07 to 0.13, static 0.05 to 0.08."""
    frames = real_disparities("d435_wall_2frames", D435_WALL_PX_MM)
    noise = measure_disparity_noise(frames, [(0, 1)])
    assert noise.residual == pytest.approx(0.115, rel=0.1)
    assert noise.frame == pytest.approx(0.10, abs=0.03)
    assert 0.05 < noise.static < 0.08
    for found, known in (
        (noise.rows, (0.94, 0.87, 0.78, 0.68, 0.46, 0.24, -0.06)),
        (noise.columns, (0.96, 0.89, 0.81, 0.71, 0.49, 0.28, 0.02)),
        (noise.frame_rows, (0.96, 0.93, 0.88, 0.82, 0.67, 0.50, 0.20)),
        (noise.frame_columns, (0.96, 0.90, 0.82, 0.72, 0.48, 0.25, -0.05)),
    ):
        assert found == pytest.approx(known, abs=0.07)
