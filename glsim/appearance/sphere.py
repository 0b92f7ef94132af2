"""Geodesic spheres: directions of even density."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_GOLDEN = (1 + 5**0.5) / 2


@lru_cache(maxsize=4)
def geodesic_sphere(divisions: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return (V, 3) unit vectors and (F, 3) triangles of an icosahedron, divided so many times.

    V is 10 * 4 ** divisions + 2. The triangles are counter-clockwise seen from outside.
    """
    a, b = 1.0, _GOLDEN
    rectangle = np.array([(-a, b, 0), (a, b, 0), (-a, -b, 0), (a, -b, 0)])
    points = np.concatenate([np.roll(rectangle, turn, axis=1) for turn in range(3)])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = _neighbours(points)
    for _ in range(divisions):
        points, faces = _divided(points, faces)
    points.setflags(write=False)
    faces.setflags(write=False)
    return points, faces


def _neighbours(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the (20, 3) triangles of the 12 corners of an icosahedron."""
    near = points @ points.T > 0.4  # neighbours: cosine 1 / sqrt(5)
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if near[i, j] and near[j, k] and near[i, k]:
                    outside = np.linalg.det(points[[i, j, k]]) > 0
                    faces.append((i, j, k) if outside else (i, k, j))
    return np.array(faces)


def _divided(
    points: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Divide every triangle into four, with the new corners on the sphere."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    middle = points[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (number.reshape(-1, 3) + len(points)).T
    a, b, c = faces.T
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([points, middle]), np.concatenate([np.stack(p, 1) for p in parts])
