"""Shells over skin: beards, brows and cloth, displaced along the normals of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array, Mask
from glsim.appearance.binding import Motion, Points
from glsim.appearance.scalp import Anchors


@dataclass(frozen=True, eq=False)
class SkinGrid:
    """A part of a source's triangles, divided where they are large.

    base: (B,) vertices of the source that are used. triangles: (T, 3) of them, for the normals.
    anchors: (N, 3) corners, as indices into ``base``. faces: (F, 3) of the N points.
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

    faces: (T, 3) of the source. chosen: (T,). points: (V, 3) mm of its reference head.
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
            triangles, divided, local, owner, points[base].astype(np.float64)
        )
        parts = [(corners, weights)]
    anchors = Anchors(parts[0][0].astype(np.int64), parts[0][1].astype(np.float32))
    return SkinGrid(base.astype(np.int64), triangles, anchors, divided)


def _halved(
    triangles: NDArray[np.int64],
    divided: NDArray[np.int64],
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
    """A shell of a subject over a grid, with a fixed height over the skin at every point."""

    def __init__(
        self, grid: SkinGrid, height_mm: NDArray[np.float32], drop_mm: Points | None = None
    ) -> None:
        """height_mm: (N,) along the normals. drop_mm: (N, 3) besides, in the skull's frame."""
        self.used = grid.base
        self._grid, self._height, self._drop = grid, height_mm[:, None], drop_mm
        corners = grid.triangles.ravel()
        self._order = np.argsort(corners, kind="stable") // 3
        present, self._starts = np.unique(np.sort(corners), return_index=True)
        if len(present) != len(grid.base):
            raise ValueError("every vertex of the base needs a triangle")

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) points over a mesh of the source."""
        grid = self._grid
        skin = vertices_mm[grid.base]
        a, b, c = (skin[grid.triangles[:, k]] for k in range(3))
        normal = np.add.reduceat(_cross(b - a, c - a)[self._order], self._starts, axis=0)
        normal /= np.maximum(np.sqrt((normal * normal).sum(axis=1, keepdims=True)), 1e-9)
        points = grid.anchors.place(skin) + grid.anchors.place(normal) * self._height
        if self._drop is not None:
            points += self._drop if motion.is_rest else self._drop @ motion.rotation.T
        return points


def _cross(a: Points, b: Points) -> Points:
    """Return (N, 3) cross products; three times as fast as np.cross."""
    out = np.empty_like(a)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[:, k] = a[:, i] * b[:, j] - a[:, j] * b[:, i]
    return out
