"""Grids over the skin: triangles of a source, subdivided if they are large, cut along lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Array, Floats, Mask, Reals, Triangles, Whole
from glsim.core.mesh import reduced, vertex_normals

#: Area of an equilateral triangle of edge 1.
_EQUILATERAL = 0.433


class Anchors(NamedTuple):
    """Points on a mesh as barycentric coordinates: vertices (N, 3) and weights (N, 3) float32."""

    corners: Whole
    weights: Floats

    def place(self, vertices_mm: Floats) -> Floats:
        """Compute the points (N, 3) float32 on another mesh of the source, mm."""
        weights, corners = self.weights, self.corners
        points = weights[:, :1] * vertices_mm[corners[:, 0]]
        points += weights[:, 1:2] * vertices_mm[corners[:, 1]]
        points += weights[:, 2:] * vertices_mm[corners[:, 2]]
        return points

    def taken(self, chosen: Whole) -> Anchors:
        """Return the anchors of the chosen points."""
        return Anchors(self.corners[chosen], self.weights[chosen])


class Blend(NamedTuple):
    """M points, each between two grid points; ``share`` is 0 at the first, 1 at the second."""

    first: Whole
    second: Whole
    share: Reals

    def of(self, values: Reals) -> Reals:
        """Interpolate grid values (N, ...) at the points: (M, ...)."""
        share = self.share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1 - share) * values[self.first] + share * values[self.second])


class SkinGrid(NamedTuple):
    """A subdivided part of a source's triangles.

    Args:
        base: (B,) indices of the source's vertices that the grid uses.
        triangles: (T, 3) indices into ``base``, for the normals.
        anchors: N points, whose corners are indices into ``base``.
        faces: (F, 3) triangles of the N points.
    """

    base: Whole
    triangles: Whole
    anchors: Anchors
    faces: Whole

    def taken(self, keep: Mask) -> tuple[SkinGrid, Whole]:
        """Return the grid of some faces, and the indices of its points in this grid."""
        used, inverse = np.unique(self.faces[keep], return_inverse=True)
        corners = self.anchors.corners[used]
        near = np.zeros(len(self.base), bool)
        near[corners] = True
        touched = self.triangles[near[self.triangles].any(axis=1)]
        base = np.unique(np.concatenate([touched.ravel(), corners.ravel()]))
        number = np.zeros(len(self.base), np.int64)
        number[base] = np.arange(len(base))
        anchors = Anchors(number[corners], self.anchors.weights[used])
        return SkinGrid(self.base[base], number[touched], anchors, inverse.reshape(-1, 3)), used

    def clipped(self, inside: Reals) -> tuple[SkinGrid, Blend]:
        """Cut the grid where (N,) values cross 0; return the part above, its points as blends."""
        kept = inside[self.faces] > 0
        whole = self.faces[kept.all(axis=1)]
        cut = self.faces[kept.any(axis=1) & ~kept.all(axis=1)]
        stays = inside[cut] > 0
        one = stays.sum(axis=1) == 1
        # Rotate each triangle so that the corner that is alone on its side comes first.
        alone = np.where(one, stays.argmax(axis=1), (~stays).argmax(axis=1))
        a, b, c = (np.take_along_axis(cut, (alone[:, None] + k) % 3, 1)[:, 0] for k in range(3))
        edges = np.concatenate([np.stack([a, b], 1), np.stack([a, c], 1)])
        ends, count = np.sort(edges, axis=1), len(self.anchors.corners)
        keys, number = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
        lines = np.stack(np.divmod(keys, count), axis=1)
        ab, ac = count + number.reshape(2, -1)
        tip = np.stack([a, ab, ac], 1)[one]
        rest = np.concatenate([np.stack([ab, b, c], 1)[~one], np.stack([ab, c, ac], 1)[~one]])
        low, high = inside[lines[:, 0]], inside[lines[:, 1]]
        every = np.arange(count)
        first, second = (np.concatenate([every, lines[:, k]]) for k in range(2))
        share = np.concatenate([np.zeros(count), low / (low - high)])
        anchors = _blended_anchors(self.anchors, Blend(first, second, share))
        grown = self._replace(anchors=anchors, faces=np.concatenate([whole, tip, rest]))
        left, used = grown.taken(np.ones(len(grown.faces), bool))
        return left, Blend(first[used], second[used], share[used])


def grid_triangles(rows: int, columns: int) -> Triangles:
    """Return the triangles of a grid of vertices; their normals are row axis x column axis."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.concatenate([np.stack([a, c, d], -1), np.stack([a, d, b], -1)]).reshape(-1, 3)


def make_grid(faces: Triangles, chosen: Mask, points: Reals, edge_mm: float) -> SkinGrid:
    """Make a grid of the chosen triangles, (T,) mask, of a reference head with vertices (V, 3) mm.

    Edges longer than ``edge_mm`` are split in halves.
    """
    base, inverse = np.unique(faces[chosen], return_inverse=True)
    triangles = inverse.reshape(-1, 3).astype(np.int64)
    corners = np.repeat(np.arange(len(base))[:, None], 3, axis=1)
    weights = np.zeros((len(base), 3), np.float32)
    weights[:, 0] = 1.0
    anchors, divided = Anchors(corners, weights), triangles
    places: Reals = points[base].astype(np.float64)
    while True:
        sides = np.sort(divided[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3, 2), axis=2)
        long = np.linalg.norm(places[sides[..., 0]] - places[sides[..., 1]], axis=2) > edge_mm
        if not long.any():
            return SkinGrid(base.astype(np.int64), triangles, anchors, divided)
        edges, number = np.unique(sides[long], axis=0, return_inverse=True)
        middle = np.full(long.shape, -1)
        middle[long] = len(places) + number.reshape(-1)
        divided = _split(divided, middle)
        every = np.arange(len(places))
        first, second = (np.concatenate([every, edges[:, k]]) for k in range(2))
        share = np.concatenate([np.zeros(len(every)), np.full(len(edges), 0.5)])
        blend = Blend(first, second, share)
        anchors, places = _blended_anchors(anchors, blend), blend.of(places)


def thinned(faces: Triangles, chosen: Mask, points_mm: Floats, edge_mm: float) -> SkinGrid:
    """Make a grid, as ``make_grid`` does, and reduce it to a mean edge of ``edge_mm``."""
    grid = make_grid(faces, chosen, points_mm, edge_mm)
    points = grid.anchors.place(points_mm[grid.base])
    a, b, c = (points[grid.faces[:, k]].astype(np.float64) for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    share = float(area) / (_EQUILATERAL * edge_mm**2 * len(grid.faces))
    if share >= 1:
        return grid
    _, left, nearest = reduced(points, grid.faces, share)
    kept, inverse = np.unique(nearest[left], return_inverse=True)
    anchors = grid.anchors.taken(kept.astype(np.int64))
    return grid._replace(anchors=anchors, faces=inverse.reshape(-1, 3))


def _split(faces: Whole, middle: Whole) -> Whole:
    """Split triangles (F, 3) at points (F, 3) on their sides 0-1, 1-2 and 2-0; -1 for none."""
    count = (middle >= 0).sum(axis=1)
    # Rotate each triangle so that its only divided, or its only undivided, side comes first.
    first = np.where(count == 1, (middle >= 0).argmax(axis=1), (middle < 0).argmax(axis=1))
    turn = (np.where((count == 1) | (count == 2), first, 0)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, 1).T
    ab, bc, ca = np.take_along_axis(middle, turn, 1).T
    parts = {
        0: ((a, b, c),),
        1: ((a, ab, c), (ab, b, c)),
        2: ((c, ca, bc), (a, b, bc), (a, bc, ca)),
        3: ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)),
    }
    return np.concatenate(
        [np.stack(part, 1)[count == n] for n, pieces in parts.items() for part in pieces]
    )


def _blended_anchors(anchors: Anchors, blend: Blend) -> Anchors:
    """Return the anchors of points between two points of the same source triangle."""
    corners = np.concatenate([anchors.corners[blend.first], anchors.corners[blend.second]], axis=1)
    share = blend.share.astype(np.float32)[:, None]
    own, other = anchors.weights[blend.first], anchors.weights[blend.second]
    weights = np.concatenate([own * (1 - share), other * share], axis=1)
    order = np.argsort(corners, axis=1, kind="stable")
    corners, weights = (np.take_along_axis(values, order, 1) for values in (corners, weights))
    for k in range(5):  # add up the weights of equal corners at the last of them
        same = corners[:, k] == corners[:, k + 1]
        weights[:, k + 1] += np.where(same, weights[:, k], 0)
        weights[same, k] = 0
    heaviest = np.argsort(-weights, axis=1, kind="stable")[:, :3]
    return Anchors(*(np.take_along_axis(values, heaviest, 1) for values in (corners, weights)))


def point_normals(grid: SkinGrid, skin_mm: Array) -> Array:
    """Compute the skin's unit normals at the grid's points, (N, 3); ``skin_mm`` is its base."""
    normal = grid.anchors.place(vertex_normals(skin_mm, grid.triangles))  # type: ignore[arg-type]
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True), np.float64)
