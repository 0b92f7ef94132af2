"""The grid that carries cloth and beards, patterns of cloth, and the noise of relief."""

import numpy as np
import pytest

from glsim.looks.noise import Pattern, pattern_factors
from glsim.looks.skin_grid import SkinGrid, make_grid


def square(step: float) -> tuple[np.ndarray, np.ndarray]:
    """A flat square of 100 mm, as vertices and triangles."""
    n = int(100 / step) + 1
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = (p.ravel() for p in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def area(points: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (points[faces[:, k]] for k in range(3))
    return float(0.5 * np.cross(b - a, c - a)[:, 2].sum())


def placed(grid: SkinGrid, points: np.ndarray) -> np.ndarray:
    return grid.anchors.place(points[grid.base].astype(np.float32))


def test_long_edges_are_halved_and_neighbours_stay_joined() -> None:
    points, faces = square(25.0)
    points[:, 0] *= 1 + 0.5 * (points[:, 1] / 100)  # edges of many lengths
    grid = make_grid(faces.astype(np.int32), np.ones(len(faces), bool), points, 12.0)
    own = placed(grid, points)
    sides = grid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert np.linalg.norm(own[sides[:, 0]] - own[sides[:, 1]], axis=1).max() <= 12.0 + 1e-3
    assert area(own, grid.faces) == pytest.approx(area(points, faces), rel=1e-5)
    lone = set(map(tuple, sides)) - set(map(tuple, sides[:, ::-1]))
    rim = own[np.unique(np.array(list(lone)))]
    right = 100 * (1 + 0.5 * rim[:, 1] / 100)
    off = np.minimum.reduce([rim[:, 0], right - rim[:, 0], rim[:, 1], 100 - rim[:, 1]])
    assert np.abs(off).max() < 1e-3  # no seam opens inside


def test_cloth_is_cut_along_a_line_not_along_triangles() -> None:
    points, faces = square(10.0)
    grid = make_grid(faces.astype(np.int32), np.ones(len(faces), bool), points, 30.0)
    own = placed(grid, points)
    left, blend = grid.clipped(60.3 - own[:, 0] - 0.3 * own[:, 1])
    cut = placed(left, points)
    assert np.allclose(blend.of(own), cut, atol=1e-3)
    assert (60.3 - cut[:, 0] - 0.3 * cut[:, 1]).min() > -1e-3
    assert area(cut, left.faces) == pytest.approx(100 * (60.3 - 15), rel=1e-4)
    assert len(grid.clipped(np.ones(len(own)))[0].faces) == len(grid.faces)


@pytest.mark.parametrize("pattern", ["plain", "mottled", "stripes", "checks", "print"])
def test_patterns_vary_about_the_albedo(pattern: Pattern) -> None:
    down, turn = (a.ravel() for a in np.meshgrid(np.arange(0, 600, 8.0), np.arange(0, 6.28, 0.05)))
    points = np.stack([130 * np.sin(turn), -down, 130 * np.cos(turn)], axis=1)
    factors = [pattern_factors(pattern, points, seed) for seed in range(8)]
    assert np.mean(factors) == pytest.approx(1, abs=0.08)
    spread = np.mean([f.std() for f in factors])
    plain = np.mean([pattern_factors("plain", points, seed).std() for seed in range(8)])
    assert (spread > 1.3 * plain) == (pattern != "plain")
