"""Refinement of quads as a linear map: subdivision and membranes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.refinement import membrane, refine, subdivide


def grid(side: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices and quads of a square of side x side quads, 10 mm each."""
    y, x = np.mgrid[: side + 1, : side + 1]
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    quads = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=1)
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1) * 10.0, quads


def area(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """Return the area of triangles, all of which must be counter-clockwise."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    signed = np.cross(b - a, c - a)[:, 2] / 2
    assert (signed > -1e-9).all()
    return float(signed.sum())


def test_large_quads_are_divided_and_no_crack_opens() -> None:
    points, quads = grid(6)
    limit_mm = np.where(points[:, 0] < 35.0, 4.0, 100.0)
    whole, triangles = refine(quads, points, limit_mm, np.zeros(len(points), dtype=bool))
    moved = whole.apply(points)
    assert np.isclose(area(moved, triangles), 3600.0)
    edges = np.sort(np.concatenate([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]))
    edges, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert count.max() == 2
    once = moved[edges[count == 1]]
    on_border = (np.abs(once - 30.0).max(axis=1)[:, :2] > 30.0 - 1e-9).any(axis=1)
    assert on_border.all()
    assert len(triangles) > 300
    totals = np.bincount(whole.rows, whole.weights, whole.height)
    np.testing.assert_allclose(totals, 1.0)


def test_a_cube_becomes_the_body_of_catmull_and_clark() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = np.array([
        [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3],
    ])  # fmt: skip
    step, fine, triangles = subdivide(quads, np.ones(6, dtype=bool), np.zeros(8, dtype=bool))
    moved = step.apply(corners)
    np.testing.assert_allclose(np.abs(moved[:8]), 5 / 9)  # the rule at a corner of a cube
    np.testing.assert_allclose(np.sort(np.abs(moved[8:20]), axis=1), [[0, 0.75, 0.75]] * 12)
    np.testing.assert_allclose(np.linalg.norm(moved[20:], axis=1), 1.0)
    assert (len(fine), len(triangles)) == (24, 0)


def test_a_membrane_flattens_what_is_inside() -> None:
    points, quads = grid(6)
    inside = np.zeros(49, dtype=bool)
    inside[[16, 17, 18, 23, 24, 25]] = True
    points[inside, 2] = 7.0
    flat = membrane(quads, inside).apply(points)
    np.testing.assert_allclose(flat[:, 2], 0.0, atol=1e-12)
    np.testing.assert_array_equal(flat[~inside], points[~inside])
    assert np.abs(flat[inside, :2] - points[inside, :2]).max() < 1e-6 + 5.0
