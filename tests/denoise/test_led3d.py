"""The clean-up of face maps after Mu et al.: outliers, the largest piece, enclosed holes."""

from __future__ import annotations

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.denoise import load_denoiser
from glsim.denoise.filters.led3d import enclosed_holes, largest_piece, outliers
from tests.support.eval_scenes import Array, dome, noisy


def run(depth: Array, spec: str = "led3d") -> Array:
    return load_denoiser(spec).estimate(depth[None]).composites()[""]


def test_outliers_are_far_from_their_four_nearest_neighbours() -> None:
    rng = np.random.default_rng(0)
    depth = (900 + rng.normal(0, 1, (20, 24))).astype(np.float32)
    depth[10, 12] += 40
    depth[5, :] = 0
    found = outliers(depth, depth > 0, 5.0)
    assert found[10, 12]
    assert found.sum() == 1
    # By hand: the mean of the four smallest distances within 3 x 3 px.
    distances = {}
    for y, x in np.argwhere(depth > 0):
        part = depth[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        others = np.sort(np.abs(part[part > 0].astype(np.float64) - depth[y, x]))[1:5]
        distances[y, x] = others.mean()
    values = np.array(list(distances.values()))
    expected = np.zeros(depth.shape, bool)
    for place, distance in distances.items():
        expected[place] = distance > values.mean() + values.std()
    np.testing.assert_array_equal(outliers(depth, depth > 0, 1.0), expected)


def test_a_pixel_without_neighbours_is_an_outlier() -> None:
    depth = dome()
    depth[2, 2] = 700
    found = outliers(depth, depth > 0, 20.0)
    assert found[2, 2]
    alone = np.zeros((5, 5), np.float32)
    alone[2, 2] = 700
    assert not run(alone).any()


def test_only_the_largest_surface_stays() -> None:
    depth = dome()
    depth[1:5, 1:7] = 950
    piece = largest_piece(depth, depth > 0)
    np.testing.assert_array_equal(piece, dome() > 0)
    wall = np.full((30, 30), 1500, np.float32)
    wall[8:18, 8:18] = 900  # no hole between the two: the step divides them
    np.testing.assert_array_equal(largest_piece(wall, wall > 0), wall == 1500)
    slope = np.linspace(900, 1300, 30, dtype=np.float32)[None].repeat(30, 0)
    assert largest_piece(slope, slope > 0).all()
    assert not largest_piece(slope, np.zeros((30, 30), bool)).any()


def test_enclosed_holes_are_filled_from_their_rim_and_others_are_not() -> None:
    depth = dome()
    inside, open_to_the_side = (slice(18, 21), slice(22, 26)), (slice(18, 20), slice(0, 12))
    depth[inside] = 0
    depth[open_to_the_side] = 0
    holes = enclosed_holes(depth > 0)
    assert holes[inside].all()
    assert holes.sum() == depth[inside].size
    out = run(depth, "led3d:deviations=20")
    assert (out[inside] > dome()[inside]).all(), "the farthest depth on the rim"
    assert (out[inside] < dome()[inside] + 6).all()
    assert not out[18:20, :8].any()


def test_noise_and_the_mask_get_better_on_a_noisy_dome() -> None:
    clean, before = dome(), noisy(dome())
    after = run(before, "led3d:deviations=5")
    assert (after[clean == 0] > 0).sum() < 0.2 * (before[clean == 0] > 0).sum()
    inner = np.zeros(clean.shape, bool)
    inner[12:28, 14:34] = True
    assert (after[inner] > 0).all()
    there = inner & (before > 0)
    errors = [np.sqrt(np.mean((d - clean)[there] ** 2)) for d in (before, after)]
    assert errors[1] < 0.7 * errors[0]
    assert np.sqrt(np.mean((after - clean)[inner & (before == 0)] ** 2)) < errors[0]


def test_windows_other_than_the_medians_are_refused() -> None:
    with pytest.raises(ConfigError, match="size 3 or 5"):
        load_denoiser("led3d:size=4")
