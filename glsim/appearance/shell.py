"""Shells over skin: beards, brows and cloth, displaced along the normals of every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array, Mask
from glsim.appearance.binding import Motion, Points
from glsim.appearance.scalp import Anchors
from glsim.geometry.products import product


@dataclass(frozen=True, eq=False)
class SkinGrid:
    """A part of a source's triangles, divided where they are large.

    Args:
        base: (B,) vertices of the source that are used.
        triangles: (T, 3) of them, for the normals.
        anchors: (N, 3) corners, as indices into ``base``.
        faces: (F, 3) of the N points.
    """

    base: NDArray[np.int64]
    triangles: NDArray[np.int64]
    anchors: Anchors
    faces: NDArray[np.int64]

    def taken(self, keep: Mask) -> tuple[SkinGrid, NDArray[np.int64]]:
        """Return the grid of the faces (F,) that are kept, and the points that it has left."""
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


def make_grid(faces: NDArray[np.int32], chosen: Mask, points: Array, edge_mm: float) -> SkinGrid:
    """Return the grid of the chosen triangles, halved until their mean edge is at most edge_mm.

    Args:
        faces: (T, 3) of the source.
        chosen: (T,).
        points: (V, 3) mm of its reference head.
    """
    base, inverse = np.unique(faces[chosen], return_inverse=True)
    triangles = inverse.reshape(-1, 3).astype(np.int64)
    corners = np.repeat(np.arange(len(base))[:, None], 3, axis=1)
    weights = np.zeros((len(base), 3), np.float32)
    weights[:, 0] = 1.0
    divided, parts = triangles, [(corners, weights)]
    places: Array = points[base].astype(np.float64)
    # After a division of an edge that was divided before, points have up to three corners.
    owner = np.arange(len(triangles))
    local: Array = np.broadcast_to(np.eye(3), (len(triangles), 3, 3))
    while len(divided) and _mean_edge(places[divided]) > edge_mm:
        divided, local, owner, places, (corners, weights) = _halved(
            triangles, local, owner, points[base].astype(np.float64)
        )
        parts = [(corners, weights)]
    anchors = Anchors(parts[0][0].astype(np.int64), parts[0][1].astype(np.float32))
    return SkinGrid(base.astype(np.int64), triangles, anchors, divided)


def _halved(
    triangles: NDArray[np.int64],
    local: Array,
    owner: NDArray[np.int64],
    places: Array,
) -> tuple[
    NDArray[np.int64],
    Array,
    NDArray[np.int64],
    Array,
    tuple[NDArray[np.int64], NDArray[np.float32]],
]:
    """Divide every triangle into four; points of neighbours coincide.

    Args:
        local: (F, 3, 3) weights of the corners of each face in the triangle ``owner`` it lies in.
    """
    a, b, c = np.moveaxis(local, 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    local = np.concatenate(
        [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )
    owner = np.tile(owner, 4)
    corners = np.repeat(triangles[owner][:, None], 3, axis=1).reshape(-1, 3)
    weights = local.reshape(-1, 3)
    # One point per place: corners in ascending order, those without weight left out.
    shown = np.where(weights > 0, corners, -1)
    order = np.argsort(shown, axis=1)
    shown = np.take_along_axis(shown, order, 1)
    sorted_weights = np.take_along_axis(weights, order, 1)
    key = np.concatenate([shown, np.round(sorted_weights * 1024).astype(np.int64)], axis=1)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    corners, weights = corners[first], weights[first]
    points = np.einsum("nk,nki->ni", weights, places[corners])
    return inverse.reshape(-1, 3), local, owner, points, (corners, weights.astype(np.float32))


def _mean_edge(corners: Array) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


class Shell:
    """A shell of a subject over a grid, with a fixed height over the skin at every point.

    At rest the height is along the smooth normals of the skin. Every point keeps that offset in the
    axes of one triangle beside it, so that a frame needs three vertices per point.
    """

    def __init__(
        self,
        grid: SkinGrid,
        rest_mm: NDArray[np.floating[Any]],
        height_mm: NDArray[np.floating[Any]],
        drop_mm: Points | None = None,
    ) -> None:
        """Lay a shell over the skin.

        Args:
            rest_mm: (V, 3) the subject's vertices at rest.
            height_mm: (N,) along the normals.
            drop_mm: (N, 3) besides, in the frame of the skull.
        """
        self.used, self._drop = grid.base, drop_mm
        skin = rest_mm[grid.base].astype(np.float64)
        offset = point_normals(grid, skin) * height_mm[:, None]
        beside = _beside(grid, skin)
        a, b, c = (skin[corner] for corner in beside.T)
        along, across = b - a, c - a
        normal = np.cross(along, across)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        high = (offset * normal).sum(axis=1)
        level = offset - high[:, None] * normal
        # In the plane of the triangle: solve the normal equations of two shares of its edges.
        aa, bb = (along * along).sum(axis=1), (across * across).sum(axis=1)
        ab = (along * across).sum(axis=1)
        la, lb = (level * along).sum(axis=1), (level * across).sum(axis=1)
        area = np.maximum(aa * bb - ab * ab, 1e-9)
        shares = np.stack([(bb * la - ab * lb) / area, (aa * lb - ab * la) / area, high])
        self._shares = shares.astype(np.float32)
        self._beside = np.ascontiguousarray(beside.T)
        self._corners = np.ascontiguousarray(grid.anchors.corners.T)
        self._weights = np.ascontiguousarray(grid.anchors.weights.T)
        self._undivided = bool((self._weights[0] == 1).all())

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) points over a mesh of the source."""
        # By column, (3, V): NumPy works along the long axis several times faster.
        skin = np.ascontiguousarray(vertices_mm[self.used].T)
        a, b, c = (skin[:, corner] for corner in self._beside)
        b -= a
        c -= a
        normal = np.stack([b[i] * c[j] - b[j] * c[i] for i, j in ((1, 2), (2, 0), (0, 1))])
        length = np.maximum(np.sqrt((normal * normal).sum(axis=0)), np.float32(1e-9))
        points = a if self._undivided else self._at_points(skin)
        points += self._shares[0] * b
        points += self._shares[1] * c
        points += (self._shares[2] / length) * normal
        placed = np.ascontiguousarray(points.T)
        if self._drop is not None:
            placed += self._drop if motion.is_rest else product(self._drop, motion.rotation.T)
        return placed

    def _at_points(self, columns: Points) -> Points:
        """Return (3, N) values at the points, from (3, V) at the vertices."""
        corners, weights = self._corners, self._weights
        points = columns[:, corners[0]] * weights[0]
        points += columns[:, corners[1]] * weights[1]
        points += columns[:, corners[2]] * weights[2]
        return np.asarray(points)


def uncovered(
    faces: NDArray[np.int32], may_hide: Mask, shells: Sequence[Shell], rings: int = 4
) -> NDArray[np.int32]:
    """Return the triangles of a mesh that shells leave visible: ``faces`` itself if all are.

    Args:
        faces: (F, 3).
        may_hide: (V,) vertices whose triangles may be left out.
        rings: of triangles that stay along the rims of each shell, where one can look under it; the
            base of a shell is one ring wider than the shell.
    """
    covered = np.zeros(len(faces), bool)
    for shell in shells:
        worn = np.zeros(len(may_hide), bool)
        worn[shell.used] = True
        hidden = worn[faces].all(axis=1)
        for _ in range(rings):
            seen = np.zeros(len(may_hide), bool)
            seen[faces[~hidden]] = True
            hidden &= ~seen[faces].any(axis=1)
        covered |= hidden & may_hide[faces].all(axis=1)
    return np.ascontiguousarray(faces[~covered]) if covered.any() else faces


def point_normals(grid: SkinGrid, skin_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3) unit normals at the points of a grid.

    Args:
        skin_mm: (B, 3) of its base.
    """
    normal = grid.anchors.place(_vertex_normals(grid, skin_mm))  # type: ignore[arg-type]
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True), np.float64)


def _vertex_normals(grid: SkinGrid, skin_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (B, 3) unit normals: of the triangles, weighted by their areas."""
    a, b, c = (skin_mm[grid.triangles[:, k]] for k in range(3))
    facing = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    corners = grid.triangles.ravel()
    columns = [np.bincount(corners, facing[:, k], len(skin_mm)) for k in range(3)]
    summed = np.stack(columns, axis=1)
    return np.asarray(summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-9))


def _beside(grid: SkinGrid, skin_mm: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (N, 3) the triangle beside each point, from the vertex that is nearest to it on.

    Of the triangles at that vertex, the one that lies most along the skin.
    """
    a, b, c = (skin_mm[grid.triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
    smooth = _vertex_normals(grid, skin_mm)[grid.triangles]  # (T, 3, 3)
    flat = np.einsum("tki,ti->tk", smooth, facing)
    turned = np.stack([np.roll(grid.triangles, -k, axis=1) for k in range(3)], axis=1)
    order = np.argsort(flat.ravel(), kind="stable")  # the best one is written last
    best = np.zeros((len(skin_mm), 3), np.int64)
    best[grid.triangles.ravel()[order]] = turned.reshape(-1, 3)[order]
    row = np.arange(len(grid.anchors.corners))
    nearest = grid.anchors.corners[row, grid.anchors.weights.argmax(axis=1)]
    return np.asarray(best[nearest])
