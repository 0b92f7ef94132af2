"""Subdivide the large quads of a mesh (Catmull and Clark 1978), as a linear map of its vertices.

The body is modelled in quads for this scheme. Only marked quads are divided: quads beside them get
triangles that meet the new vertices on their edges, so that the mesh stays watertight. Vertices are
smoothed where all faces around them are divided and stay where they are elsewhere. (trimesh has
Loop's scheme, for triangles, and moves vertices; a map is needed here, because it is applied to
every subject and once to every expression.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LinearMap:
    """A sparse matrix: the weights of input vertices in output vertices.

    Args:
        rows, columns: (N,) int64.
        weights: (N,) float64.
        height: number of output vertices.
    """

    rows: _Ints
    columns: _Ints
    weights: NDArray[np.float64]
    height: int

    @staticmethod
    def identity(size: int) -> LinearMap:
        """The map that changes nothing."""
        same = np.arange(size)
        return LinearMap(same, same, np.ones(size), size)

    def after(self, first: LinearMap) -> LinearMap:
        """The map that applies ``first``, then this one."""
        order = np.argsort(first.rows, kind="stable")
        rows, columns, weights = (
            part[order] for part in (first.rows, first.columns, first.weights)
        )
        start = np.searchsorted(rows, self.columns)
        count = np.searchsorted(rows, self.columns, side="right") - start
        entry = np.repeat(np.arange(len(self.rows)), count)
        within = np.arange(len(entry)) - np.repeat(np.cumsum(count) - count, count)
        inner = start[entry] + within
        width = int(first.columns.max()) + 1
        key = self.rows[entry] * width + columns[inner]
        unique, inverse = np.unique(key, return_inverse=True)
        total: NDArray[np.float64] = np.bincount(
            inverse, self.weights[entry] * weights[inner]
        ).astype(np.float64)
        return LinearMap(unique // width, unique % width, total, self.height)

    def apply(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (height, ...) weighted sums of ``values`` (inputs, ...)."""
        flat = values.reshape(len(values), -1)
        moved = [
            np.bincount(self.rows, self.weights * column[self.columns], self.height)
            for column in flat.T
        ]
        stacked = np.stack(moved, axis=1).astype(np.float64)
        return stacked.reshape(self.height, *values.shape[1:])


@dataclass(frozen=True, eq=False)
class Subdivided:
    """A mesh after one step. The old vertices keep their numbers; new ones follow.

    Args:
        quads, triangles: (Q, 4) and (T, 3), the triangles being those beside divided quads.
    """

    map: LinearMap
    quads: _Ints
    triangles: _Ints


def subdivide(quads: _Ints, marked: NDArray[np.bool_], fixed: NDArray[np.bool_]) -> Subdivided:
    """Divide the marked quads into four each.

    Args:
        marked: (Q,).
        fixed: (V,) vertices of faces that are not among the quads: they stay, and no quad with two
            of them in a row may be marked.
    """
    size = len(fixed)
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2), axis=2)
    key, edge_of = np.unique(ends[..., 0] * size + ends[..., 1], return_inverse=True)
    edge_of = edge_of.reshape(quads.shape)
    ends = np.stack([key // size, key % size], axis=1)
    faces_at = np.bincount(edge_of.ravel(), minlength=len(key))
    divided_at = np.bincount(edge_of[marked].ravel(), minlength=len(key))
    split = divided_at > 0
    beside = ~marked & split[edge_of].any(axis=1)
    edge_point = np.full(len(key), -1)
    edge_point[split] = size + np.arange(split.sum())
    with_point = marked | beside
    face_point = np.full(len(quads), -1)
    face_point[with_point] = size + split.sum() + np.arange(with_point.sum())
    inner = ~fixed
    for whole, wanted in ((quads[~marked], False), (ends[faces_at != 2], False)):
        inner[whole.ravel()] = wanted
    inner &= np.bincount(quads[marked].ravel(), minlength=size) > 0
    parts = [
        _vertex_points(quads, ends, inner),
        _edge_points(quads, marked, edge_of, ends, edge_point, divided_at == 2),
        _rows(np.repeat(face_point[with_point], 4), quads[with_point].ravel(), 0.25),
    ]
    rows, columns, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
    height = size + int(split.sum()) + int(with_point.sum())
    after, centre = edge_point[edge_of], face_point[:, None]
    small = np.stack(
        [quads, after, np.broadcast_to(centre, quads.shape), np.roll(after, 1, axis=1)], axis=2
    )
    return Subdivided(
        LinearMap(rows, columns, weights, height),
        np.concatenate([quads[~with_point], small[marked].reshape(-1, 4)]),
        _fans(quads[beside], after[beside], face_point[beside]),
    )


def _rows(
    rows: _Ints, columns: _Ints, weight: float | NDArray[np.float64]
) -> tuple[_Ints, _Ints, NDArray[np.float64]]:
    return rows, columns, np.broadcast_to(np.asarray(weight, dtype=np.float64), rows.shape)


def _vertex_points(
    quads: _Ints, ends: _Ints, inner: NDArray[np.bool_]
) -> tuple[_Ints, _Ints, NDArray[np.float64]]:
    """Weights of the old vertices: (mean face point + 2 mean edge middle + (n - 3) itself) / n."""
    still, around = np.flatnonzero(~inner), np.flatnonzero(inner)
    valence = np.maximum(np.bincount(quads.ravel(), minlength=len(inner)), 1).astype(np.float64)
    pairs = np.concatenate([ends, ends[:, ::-1]])
    pairs = pairs[inner[pairs[:, 0]]]
    here = np.repeat(quads.ravel(), 4)
    corner = np.repeat(quads, 4, axis=0).ravel()
    seen = inner[here]
    here, corner = here[seen], corner[seen]
    parts = [
        _rows(still, still, 1.0),
        _rows(around, around, (valence[around] - 3.0 + 1.0) / valence[around]),
        _rows(pairs[:, 0], pairs[:, 1], 1.0 / valence[pairs[:, 0]] ** 2),
        _rows(here, corner, 0.25 / valence[here] ** 2),
    ]
    rows, columns, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
    return rows, columns, weights


def _edge_points(
    quads: _Ints,
    marked: NDArray[np.bool_],
    edge_of: _Ints,
    ends: _Ints,
    edge_point: _Ints,
    smooth: NDArray[np.bool_],
) -> tuple[_Ints, _Ints, NDArray[np.float64]]:
    """Weights of the points on edges: the middle, or its mean with the two face points."""
    split = edge_point >= 0
    own = np.where(smooth, 0.25, 0.5)[split]
    edges, corners = edge_of[marked], quads[marked]
    of_face = np.repeat(edges.ravel(), 4)
    corner = np.repeat(corners, 4, axis=0).ravel()
    seen = smooth[of_face]
    parts = [
        _rows(edge_point[split], ends[split, 0], own),
        _rows(edge_point[split], ends[split, 1], own),
        _rows(edge_point[of_face[seen]], corner[seen], 0.0625),
    ]
    rows, columns, weights = (np.concatenate(part) for part in zip(*parts, strict=True))
    return rows, columns, weights


def _fans(quads: _Ints, after: _Ints, centre: _Ints) -> _Ints:
    """Triangles from the centre of each quad to its corners and the new points on its edges."""
    fans = []
    for corner in range(4):
        start, middle = quads[:, corner], after[:, corner]
        end = quads[:, (corner + 1) % 4]
        new = middle >= 0
        fans.append(np.stack([centre, start, np.where(new, middle, end)], axis=1))
        fans.append(np.stack([centre, middle, end], axis=1)[new])
    return np.concatenate(fans)
