"""Shells over skin: beards, brows and cloth, displaced along the normals of every frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import vertex_normals
from glsim.core.products import product
from glsim.looks.anatomy import Array, Mask
from glsim.looks.binding import Motion, Points
from glsim.looks.skin_grid import SkinGrid, point_normals


class Shell:
    """A shell of a subject over a grid, with a fixed offset from the skin at every point.

    Every point keeps its offset in the axes of one triangle beside it, so that a frame needs three
    vertices per point.
    """

    def __init__(
        self,
        grid: SkinGrid,
        rest_mm: NDArray[np.floating[Any]],
        offset_mm: NDArray[np.floating[Any]],
        drop_mm: Points | None = None,
    ) -> None:
        """Lay a shell over the skin.

        Args:
            rest_mm: (V, 3) the subject's vertices at rest.
            offset_mm: (N,) along the smooth normals of the skin, or (N, 3) in the axes at rest.
            drop_mm: (N, 3) besides, in the frame of the skull.
        """
        self.used = grid.base
        moved = np.zeros(0, np.int64) if drop_mm is None else np.flatnonzero(drop_mm.any(axis=1))
        self._dropped = moved
        self._drop = None if drop_mm is None else drop_mm[moved]
        skin = rest_mm[grid.base].astype(np.float64)
        offset = offset_mm
        if offset.ndim == 1:
            offset = point_normals(grid, skin) * offset[:, None]
        beside = _beside(grid, skin)
        axes = _axes(*(np.ascontiguousarray(skin[corner].T) for corner in beside.T))
        shares = np.stack([(offset.T * axis).sum(axis=0) for axis in axes])
        self._shares = shares.astype(np.float32)
        self._beside = np.ascontiguousarray(beside.T)
        self._between = np.flatnonzero(grid.anchors.weights[:, 0] != 1)
        between = grid.anchors.taken(self._between)
        self._corners = np.ascontiguousarray(between.corners.T)
        self._weights = np.ascontiguousarray(between.weights.T)

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) points over a mesh of the source."""
        skin = np.ascontiguousarray(vertices_mm[self.used].T)
        corners = [skin[:, corner] for corner in self._beside]
        points = corners[0].copy()
        if len(self._between):
            points[:, self._between] = self._at_points(skin)
        for share, axis in zip(self._shares, _axes(*corners), strict=True):
            points += share * axis
        placed = np.ascontiguousarray(points.T)
        if self._drop is not None:
            drop = self._drop if motion.is_rest else product(self._drop, motion.rotation.T)
            placed[self._dropped] += drop
        return placed

    def _at_points(self, columns: Points) -> Points:
        """Return (3, M) values at the points between vertices, from (3, V) at the vertices."""
        corners, weights = self._corners, self._weights
        points = columns[:, corners[0]] * weights[0]
        points += columns[:, corners[1]] * weights[1]
        points += columns[:, corners[2]] * weights[2]
        return np.asarray(points)


def _axes(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """Return three orthogonal (3, N) unit vectors: along a side of triangles, across, outwards.

    Args:
        a, b, c: (3, N) mm, by column: NumPy works along the long axis several times faster.
    """
    along = b - a
    along /= np.maximum(np.sqrt((along * along).sum(axis=0)), 1e-9)
    out = _crossed(along, c - a)
    out /= np.maximum(np.sqrt((out * out).sum(axis=0)), 1e-9)
    return along, _crossed(out, along), out


def _crossed(first: Array, second: Array) -> Array:
    """Return the (3, N) cross products of (3, N) vectors."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return np.stack([first[i] * second[j] - first[j] * second[i] for i, j in pairs])


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


def _beside(grid: SkinGrid, skin_mm: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (N, 3) the triangle beside each point, from the vertex that is nearest to it on.

    Of the triangles at that vertex, the one that lies most along the skin.
    """
    a, b, c = (skin_mm[grid.triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
    smooth = vertex_normals(skin_mm, grid.triangles)[grid.triangles]  # (T, 3, 3)
    flat = np.einsum("tki,ti->tk", smooth, facing)
    turned = np.stack([np.roll(grid.triangles, -k, axis=1) for k in range(3)], axis=1)
    order = np.argsort(flat.ravel(), kind="stable")  # the best one is written last
    best = np.zeros((len(skin_mm), 3), np.int64)
    best[grid.triangles.ravel()[order]] = turned.reshape(-1, 3)[order]
    row = np.arange(len(grid.anchors.corners))
    nearest = grid.anchors.corners[row, grid.anchors.weights.argmax(axis=1)]
    return np.asarray(best[nearest])
