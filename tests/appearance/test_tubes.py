"""Cloth around a tube, the grid that carries it, and its patterns."""

from __future__ import annotations

import numpy as np
import pytest

from glsim.appearance.folds import crests
from glsim.appearance.noise import openings
from glsim.appearance.patterns import pattern_factors
from glsim.appearance.scalp import Anchors
from glsim.appearance.skin_grid import SkinGrid, make_grid
from glsim.appearance.tubes import Tube, hang, make_tube


def trunk(radius) -> Tube:  # type: ignore[no-untyped-def]
    """A trunk of 600 mm whose radius depends on angle and height."""
    down, angle = np.meshgrid(np.arange(0, 600, 8.0), np.arange(0, 2 * np.pi, 0.05), indexing="ij")
    reach = radius(angle, down)
    points = np.stack([reach * np.sin(angle), -down, reach * np.cos(angle)], axis=2).reshape(-1, 3)
    origin, ahead = np.zeros(3), np.array([0.0, 0.0, 1.0])
    return make_tube(np.arange(len(points)), points, origin, np.array([0, -1.0, 0]), ahead, 72)


def test_cloth_spans_a_hollow_between_two_bumps() -> None:
    def bumps(angle, down):  # type: ignore[no-untyped-def]
        two = np.exp(-(((angle - 0.45) / 0.2) ** 2)) + np.exp(-(((angle - 5.83) / 0.2) ** 2))
        return 110 + 50 * two * np.exp(-(((down - 200) / 40) ** 2))

    tube = trunk(bumps)
    cloth = hang(tube, np.zeros(8), 0.1, 40)
    ahead = (np.abs(np.sin(tube.angle)) < 0.06) & (np.cos(tube.angle) > 0)
    at = ahead & (np.abs(tube.along - 200) < 12)
    chord = 160 * np.cos(0.45)
    assert cloth[at].mean() == pytest.approx(chord, abs=6)
    # It hangs from the bumps, 0.1 mm nearer to the axis per mm down.
    beside = (np.abs(tube.angle - 0.45) < 0.04) & (np.abs(tube.along - 400) < 6)
    assert cloth[beside].mean() == pytest.approx(160 - 0.1 * 200, abs=6)
    assert (cloth > tube.radius - 2.5).all()


def test_straight_cloth_on_a_cylinder_keeps_its_ease() -> None:
    tube = trunk(lambda angle, down: 100 + 0 * angle)
    assert hang(tube, np.full(4, 12.0), 0.0, 40) == pytest.approx(112, abs=0.6)
    widening = hang(tube, np.zeros(4), -0.2, 40)
    low = tube.along > 500
    assert widening[low] == pytest.approx(100 + 0.2 * tube.along[low], abs=6)


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
    inside = 60.3 - own[:, 0] - 0.3 * own[:, 1]
    left, blend = grid.clipped(inside)
    cut = placed(left, points)
    assert np.allclose(blend.of(own), cut, atol=1e-3)
    assert (60.3 - cut[:, 0] - 0.3 * cut[:, 1]).min() > -1e-3
    assert area(cut, left.faces) == pytest.approx(100 * (60.3 - 15), rel=1e-4)


def test_a_cut_that_leaves_all_leaves_all() -> None:
    points, faces = square(20.0)
    corners = np.repeat(np.arange(len(points))[:, None], 3, axis=1)
    weights = np.tile(np.array([1, 0, 0], np.float32), (len(points), 1))
    grid = SkinGrid(np.arange(len(points)), faces, Anchors(corners, weights), faces)
    left, blend = grid.clipped(np.ones(len(points)))
    assert len(left.faces) == len(faces)
    assert np.array_equal(blend.first, np.arange(len(points)))


def test_folds_are_longer_than_wide() -> None:
    """Along their crests folds change far less than across."""
    line = np.arange(0, 2000, 4.0)[:, None]
    zero = np.zeros((len(line), 2))
    across = crests(np.hstack([line, zero]) / (60, 300, 60), 3)
    along = crests(np.hstack([zero[:, :1], line, zero[:, :1]]) / (60, 300, 60), 3)
    assert np.abs(np.diff(across)).mean() > 3 * np.abs(np.diff(along)).mean()


@pytest.mark.parametrize("pattern", ["plain", "mottled", "stripes", "checks", "print"])
def test_patterns_vary_about_the_albedo(pattern) -> None:  # type: ignore[no-untyped-def]
    tube = trunk(lambda angle, down: 130 + 0 * angle)
    points = tube.radius[:, None] * tube.out - tube.along[:, None] * np.array([0.0, 1.0, 0.0])
    factors = [pattern_factors(pattern, points, seed) for seed in range(8)]
    assert np.mean(factors) == pytest.approx(1, abs=0.08)
    spread = np.mean([f.std() for f in factors])
    plain = np.mean([pattern_factors("plain", points, seed).std() for seed in range(8)])
    assert (spread > 1.3 * plain) == (pattern != "plain")
    assert np.array_equal(factors[3], pattern_factors(pattern, points, 3))


def test_light_gets_into_hair_as_far_as_beer_and_lambert_say() -> None:
    """The depths at which it returns are exponential: mean and standard deviation 1."""
    places = np.random.default_rng(0).uniform(0, 300, (200_000, 3))
    depth = openings(places, 3)
    assert depth.min() >= 0
    assert depth.mean() == pytest.approx(1, abs=0.05)
    assert depth.std() == pytest.approx(1, abs=0.1)
    assert np.median(depth) == pytest.approx(np.log(2), abs=0.05)
