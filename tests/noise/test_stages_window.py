"""Structured light: the dots, the correlation window's rule, and the spread of its dots."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.numpy_twins.edges import dot_place, place_pixel
from tests.support.stage_harness import (
    FOCAL_BASELINE,
    HEIGHT,
    WIDTH,
    Z_MAX,
    Image,
    flat,
    run_shader,
    scene,
    z_correlation,
)

CELLS = (-(-HEIGHT // 3), -(-WIDTH // 3))


def dots(rows: int = CELLS[0], columns: int = CELLS[1]) -> tuple[NDArray[np.int64], ...]:
    """Column and row of each cell's dot."""
    x, y = np.arange(columns)[None, :], np.arange(rows)[:, None]
    return place_pixel(x, y, dot_place(x, y))


def window_of(cell: tuple[int, int]) -> list[tuple[int, int]]:
    """Rows and columns of all dots in the 9x9 pixels around a cell's dot."""
    x, y = dots()
    near = (np.abs(x - x[cell]) <= 4) & (np.abs(y - y[cell]) <= 4)
    return list(zip(y[near].tolist(), x[near].tolist(), strict=True))


def rule(depth: Image, cell: tuple[int, int], inlier_px: float = 0.1) -> bool:
    """The window's rule of BlenSor and render_kinect, dot by dot."""
    x, y = (int(part[cell]) for part in dots())
    if depth[y, x] <= 0:
        return False
    around = window_of(cell)
    seen = [(r, c, FOCAL_BASELINE / float(depth[r, c])) for r, c in around if depth[r, c] > 0]
    if 3 * len(seen) <= 2 * len(around):
        return False
    mean = sum(d for _, _, d in seen) / len(seen)
    agree = 0
    for r, c, d in seen:
        squared = (1.2 * (r - y)) ** 2 + (1.2 * (c - x)) ** 2
        agree += abs(d - mean) / (squared or 1.0) < inlier_px
    return 3 * agree > 2 * len(around)


def test_one_dot_in_nine_pixels() -> None:
    x, y = dots(140, 170)
    image = np.zeros((420, 510), np.int64)
    np.add.at(image, (y.ravel(), x.ravel()), 1)
    assert image.sum() * 9 == image.size
    assert (image.reshape(140, 3, 170, 3).sum(axis=(1, 3)) == 1).all()
    place = dot_place(np.arange(170)[None, :], np.arange(140)[:, None])
    counts = np.bincount(place.ravel(), minlength=9)
    chi = ((counts - place.size / 9) ** 2).sum() / (place.size / 9)
    assert abs(chi - 8) / np.sqrt(16) < Z_MAX
    for lag in ((0, 1), (1, 0), (1, 1)):
        assert abs(z_correlation(place, np.roll(place, lag, axis=(0, 1)))) < Z_MAX


@pytest.mark.parametrize("seed", [0, 1])
def test_window_follows_the_rule(context: moderngl.Context, seed: int) -> None:
    layers = scene(seed)
    match = run_shader(context, "correlation_window", layers)["dot_match"]
    depth = np.pad(layers["depth"], ((0, 3), (0, 3)))  # cells beyond the last pixels
    some = [(r, c) for r in range(3, CELLS[0] - 3, 3) for c in range(3, CELLS[1] - 3, 2)]
    wrong = sum(bool(match[cell]) != rule(depth, cell) for cell in some)
    assert 0.2 < np.mean([bool(match[cell]) for cell in some]) < 0.95
    assert wrong <= 1  # float32 against float64 at the limit of a comparison


@pytest.mark.parametrize("radius", [0.5, 1.5, 3.1, 3.9])
def test_each_pixel_takes_the_nearest_dot(context: moderngl.Context, radius: float) -> None:
    layers = scene(2)
    rng = np.random.default_rng(0)
    layers["depth"] = rng.uniform(0.5, 1.5, (HEIGHT, WIDTH)).astype(np.float32)
    layers["dot_match"] = layers["dot_match"] * (rng.random(CELLS) < 0.5)
    depth = run_shader(context, "dot_spread", layers, radius_px=radius)["depth"]
    x, y = dots()
    match = (layers["dot_match"] > 0) & (x < WIDTH) & (y < HEIGHT)
    x, y = x[match], y[match]
    value = layers["depth"][y, x]
    rows = rng.choice(HEIGHT, 20, replace=False)
    for row in rows:
        squared = (np.arange(WIDTH)[:, None] - x) ** 2 + (row - y) ** 2
        least = squared.min(axis=1)
        reached = least < np.float32(radius) ** 2
        np.testing.assert_array_equal(depth[row] > 0, reached)
        # Any of several equally near dots is right.
        fits = (squared == least[:, None]) & (value == depth[row][:, None])
        assert fits.any(axis=1)[reached].all()


def test_spread_reasons(context: moderngl.Context) -> None:
    layers = scene(3)
    written = run_shader(context, "dot_spread", layers)
    before, after = layers["depth"] > 0, written["depth"] > 0
    clean = layers["clean"] > 0
    # The scene has no noise: the depth of a pixel tells its dot.
    other = np.abs(written["depth"] - layers["clean"]) > np.float32(0.02)
    for pixels, code in (
        (before & ~after, Reason.WINDOW),
        (~before & after & clean, Reason.MOVED),
        (~before & after & ~clean, Reason.GROWN),
        (before & after & ~other, Reason.VALID),
        (before & after & other, Reason.MOVED),
    ):
        assert pixels.any()
        assert (written["reason"][pixels] == code).all()
    np.testing.assert_array_equal(
        written["reason"][~before & ~after], layers["reason"][~before & ~after]
    )


def test_a_plane_comes_through_whole(context: moderngl.Context) -> None:
    """A radius of 3.1 px reaches every pixel if all dots match, and no depth is invented."""
    layers = flat(0.9)
    layers |= run_shader(context, "correlation_window", layers)
    depth = run_shader(context, "dot_spread", layers)["depth"][12:-12, 12:-12]
    assert (depth == np.float32(0.9)).all()
