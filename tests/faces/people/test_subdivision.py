"""Subdivision of quads as a linear map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.membrane import membrane
from glsim.faces.people.subdivision import LinearMap, Subdivided, subdivide


def grid(side: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices and quads of a square of side x side quads, 10 mm each."""
    y, x = np.mgrid[: side + 1, : side + 1]
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    quads = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=1)
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1) * 10.0, quads


def area(points: NDArray[np.float64], step: Subdivided) -> float:
    """Return the area of all faces; all triangles must be counter-clockwise."""
    triangles = np.concatenate([step.triangles, step.quads[:, :3], step.quads[:, [0, 2, 3]]])
    a, b, c = points[triangles].transpose(1, 0, 2)
    signed = np.cross(b - a, c - a)[:, 2] / 2
    assert (signed > -1e-9).all()
    return float(signed.sum())


def edge_counts(step: Subdivided) -> NDArray[np.int64]:
    """Return the number of faces at each edge."""
    parts = [
        np.stack([step.quads, np.roll(step.quads, -1, axis=1)], axis=2).reshape(-1, 2),
        np.stack([step.triangles, np.roll(step.triangles, -1, axis=1)], axis=2).reshape(-1, 2),
    ]
    edges = np.sort(np.concatenate(parts), axis=1)
    return np.asarray(np.unique(edges, axis=0, return_counts=True)[1])


def test_some_quads_are_divided_and_no_crack_opens() -> None:
    points, quads = grid(6)
    marked = np.zeros(len(quads), dtype=bool)
    marked[[14, 15, 16, 20, 21, 22, 35]] = True
    step = subdivide(quads, marked, np.zeros(len(points), dtype=bool))
    moved = step.map.apply(points)
    assert np.isclose(area(moved, step), 3600.0)
    assert (edge_counts(step) == 1).sum() == 24 + 2  # the border, two of its edges divided
    assert edge_counts(step).max() == 2
    assert len(step.quads) > 4 * marked.sum()
    np.testing.assert_array_equal(moved[: len(points), 2], 0.0)


def test_a_cube_becomes_the_body_of_catmull_and_clark() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = np.array([
        [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3],
    ])  # fmt: skip
    step = subdivide(quads, np.ones(6, dtype=bool), np.zeros(8, dtype=bool))
    moved = step.map.apply(corners)
    np.testing.assert_allclose(np.abs(moved[:8]), 5 / 9)  # the rule at a corner of a cube
    np.testing.assert_allclose(np.sort(np.abs(moved[8:20]), axis=1), [[0, 0.75, 0.75]] * 12)
    np.testing.assert_allclose(np.linalg.norm(moved[20:], axis=1), 1.0)
    assert len(step.quads) == 24
    assert len(step.triangles) == 0


def test_weights_add_up_to_one_over_two_steps() -> None:
    points, quads = grid(5)
    first = subdivide(quads, np.arange(25) % 3 > 0, np.zeros(36, dtype=bool))
    fixed = np.zeros(first.map.height, dtype=bool)
    fixed[first.triangles.ravel()] = True
    held = fixed[first.quads]
    free = ~np.any(held & np.roll(held, -1, axis=1), axis=1)
    second = subdivide(first.quads, free, fixed)
    whole = second.map.after(first.map)
    totals = np.bincount(whole.rows, whole.weights, whole.height)
    np.testing.assert_allclose(totals, 1.0)
    np.testing.assert_allclose(whole.apply(points), second.map.apply(first.map.apply(points)))
    same = LinearMap.identity(36)
    np.testing.assert_array_equal(same.apply(points), points)


def test_a_membrane_flattens_what_is_inside() -> None:
    points, quads = grid(6)
    inside = np.zeros(49, dtype=bool)
    inside[[16, 17, 18, 23, 24, 25]] = True
    points[inside, 2] = 7.0
    flat = membrane(quads, inside).apply(points)
    np.testing.assert_allclose(flat[:, 2], 0.0, atol=1e-12)
    np.testing.assert_array_equal(flat[~inside], points[~inside])
    assert np.abs(flat[inside, :2] - points[inside, :2]).max() < 1e-6 + 5.0
    nothing = membrane(quads, np.zeros(49, dtype=bool))
    np.testing.assert_array_equal(nothing.apply(points), points)
