"""Refine the base mesh: divide its large quads, and stretch a membrane over small parts, as maps.

The body is modelled in quads for the scheme of Catmull and Clark (1978). Only marked quads are
divided: quads beside them get triangles that meet the new vertices on their edges, so that the mesh
stays watertight. Vertices are smoothed where all faces around them are divided and stay where they
are elsewhere. (trimesh has Loop's scheme, for triangles, and moves vertices; a map is needed here,
because it is applied to every subject and once to every expression.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.products import solve

_Ints = NDArray[np.int64]
_Floats = NDArray[np.float64]
_Entries = tuple[_Ints, _Ints, _Floats]  # of a sparse matrix: rows, columns, weights

_STEPS: Final = 3


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
    weights: _Floats
    height: int

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
        total = np.bincount(inverse, self.weights[entry] * weights[inner]).astype(np.float64)
        return LinearMap(unique // width, unique % width, total, self.height)

    def apply(self, values: _Floats) -> _Floats:
        """Return (height, ...) weighted sums of ``values`` (inputs, ...)."""
        flat = values.reshape(len(values), -1)
        moved = [
            np.bincount(self.rows, self.weights * column[self.columns], self.height)
            for column in flat.T
        ]
        stacked = np.stack(moved, axis=1).astype(np.float64)
        return stacked.reshape(self.height, *values.shape[1:])


def refine(
    quads: _Ints, points: _Floats, limit_mm: _Floats, bare: NDArray[np.bool_]
) -> tuple[LinearMap, _Ints]:
    """Divide large quads, up to three times.

    Args:
        quads: (Q, 4).
        points: (P, 3) mm.
        limit_mm: (P,) mean edge above which quads at a vertex are divided.
        bare: (P,) vertices that a membrane replaces first.

    Returns:
        The map to the fine vertices, and the (F, 3) triangles.
    """
    whole = membrane(quads, bare)
    triangles: list[_Ints] = []
    fixed = np.zeros(len(points), dtype=bool)
    for _ in range(_STEPS):
        corners = whole.apply(points)[quads]
        length = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).mean(axis=1)
        held = fixed[quads]
        free = ~(held & np.roll(held, -1, axis=1)).any(axis=1)
        marked = (length > whole.apply(limit_mm)[quads].mean(axis=1)) & free
        step, quads, fans = subdivide(quads, marked, fixed)
        whole = step.after(whole)
        triangles.append(fans)
        fixed = np.zeros(step.height, dtype=bool)
        fixed[np.concatenate(triangles).ravel()] = True
    # The quads that are left are split along their shorter diagonal.
    a, b, c, d = whole.apply(points)[quads].transpose(1, 0, 2)
    first = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
    turned = np.where(first[:, None], quads, np.roll(quads, -1, axis=1))
    return whole, np.concatenate([*triangles, turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])


def membrane(quads: _Ints, inside: NDArray[np.bool_]) -> LinearMap:
    """Return the map that puts each inner vertex at the mean of its neighbours; others stay.

    Args:
        quads: (Q, 4).
        inside: (V,), a few hundred vertices at most: the equations are dense.
    """
    size = len(inside)
    inner, outer = np.flatnonzero(inside), np.flatnonzero(~inside)
    pairs = np.concatenate([np.stack([quads, np.roll(quads, by, axis=1)], axis=2) for by in (1, 3)])
    pairs = np.unique(pairs.reshape(-1, 2), axis=0)
    pairs = pairs[inside[pairs[:, 0]]]
    number = np.full(size, -1)
    number[inner] = np.arange(len(inner))
    among = np.zeros((len(inner), len(inner)))
    border, of_border = np.unique(pairs[~inside[pairs[:, 1]], 1], return_inverse=True)
    from_border = np.zeros((len(inner), len(border)))
    both = inside[pairs[:, 1]]
    np.fill_diagonal(among, np.bincount(number[pairs[:, 0]], minlength=len(inner)))
    among[number[pairs[both, 0]], number[pairs[both, 1]]] = -1.0
    from_border[number[pairs[~both, 0]], of_border] = 1.0
    weights = solve(among, from_border)
    row, column = np.nonzero(weights > 1e-6)
    entries = [(outer, outer, np.ones(len(outer)))]
    entries.append((inner[row], border[column], weights[row, column]))
    return LinearMap(*_joined(entries), size)


def subdivide(
    quads: _Ints, marked: NDArray[np.bool_], fixed: NDArray[np.bool_]
) -> tuple[LinearMap, _Ints, _Ints]:
    """Divide the marked quads into four each. The old vertices keep their numbers; new ones follow.

    Args:
        marked: (Q,).
        fixed: (V,) vertices of faces that are not among the quads: they stay, and no quad with two
            of them in a row may be marked.

    Returns:
        The map to the new vertices, the (Q', 4) quads, and the (T, 3) triangles beside them.
    """
    size = len(fixed)
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2), axis=2)
    key, edge_of = np.unique(ends[..., 0] * size + ends[..., 1], return_inverse=True)
    edge_of = edge_of.reshape(quads.shape)
    ends = np.stack([key // size, key % size], axis=1)
    faces_at = np.bincount(edge_of.ravel(), minlength=len(key))
    divided_at = np.bincount(edge_of[marked].ravel(), minlength=len(key))
    split = divided_at > 0
    with_point = marked | split[edge_of].any(axis=1)
    beside = with_point & ~marked
    edge_point, face_point = np.full(len(key), -1), np.full(len(quads), -1)
    edge_point[split] = size + np.arange(split.sum())
    face_point[with_point] = size + split.sum() + np.arange(with_point.sum())
    inner = ~fixed
    inner[quads[~marked].ravel()] = False
    inner[ends[faces_at != 2].ravel()] = False
    inner &= np.bincount(quads[marked].ravel(), minlength=size) > 0
    entries = _vertex_points(quads, ends, inner)
    entries += _edge_points(quads[marked], edge_of[marked], ends, edge_point, divided_at == 2)
    entries.append(_even(np.repeat(face_point[with_point], 4), quads[with_point].ravel(), 0.25))
    height = size + int(split.sum()) + int(with_point.sum())
    after, centre = edge_point[edge_of], face_point[:, None]
    small = np.stack(
        [quads, after, np.broadcast_to(centre, quads.shape), np.roll(after, 1, axis=1)], axis=2
    )
    return (
        LinearMap(*_joined(entries), height),
        np.concatenate([quads[~with_point], small[marked].reshape(-1, 4)]),
        _fans(quads[beside], after[beside], face_point[beside]),
    )


def _even(rows: _Ints, columns: _Ints, weight: float) -> _Entries:
    return rows, columns, np.full(len(rows), weight)


def _joined(entries: list[_Entries]) -> _Entries:
    rows, columns, weights = (np.concatenate(part) for part in zip(*entries, strict=True))
    return rows, columns, weights


def _vertex_points(quads: _Ints, ends: _Ints, inner: NDArray[np.bool_]) -> list[_Entries]:
    """Weights of the old vertices: (mean face point + 2 mean edge middle + (n - 3) itself) / n."""
    still, around = np.flatnonzero(~inner), np.flatnonzero(inner)
    valence = np.maximum(np.bincount(quads.ravel(), minlength=len(inner)), 1).astype(np.float64)
    pairs = np.concatenate([ends, ends[:, ::-1]])
    pairs = pairs[inner[pairs[:, 0]]]
    here, corner = np.repeat(quads.ravel(), 4), np.repeat(quads, 4, axis=0).ravel()
    seen = inner[here]
    here, corner = here[seen], corner[seen]
    return [
        _even(still, still, 1.0),
        (around, around, (valence[around] - 3.0 + 1.0) / valence[around]),
        (pairs[:, 0], pairs[:, 1], 1.0 / valence[pairs[:, 0]] ** 2),
        (here, corner, 0.25 / valence[here] ** 2),
    ]


def _edge_points(
    quads: _Ints, edges: _Ints, ends: _Ints, edge_point: _Ints, smooth: NDArray[np.bool_]
) -> list[_Entries]:
    """Weights of the points on edges: the middle, or its mean with the two face points.

    Args:
        quads, edges: (Q, 4) the divided quads, and their edges.
        ends: (E, 2) vertices of each edge.
        edge_point: (E,) the point on each edge, or -1.
        smooth: (E,) whether both quads at an edge are divided.
    """
    split = edge_point >= 0
    own = np.where(smooth, 0.25, 0.5)[split]
    of_face, corner = np.repeat(edges.ravel(), 4), np.repeat(quads, 4, axis=0).ravel()
    seen = smooth[of_face]
    return [
        (edge_point[split], ends[split, 0], own),
        (edge_point[split], ends[split, 1], own),
        _even(edge_point[of_face[seen]], corner[seen], 0.0625),
    ]


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
