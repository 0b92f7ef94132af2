"""Meshes that follow a moving head: rigid objects, rooted hair, and shells over the skin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from glsim.core.array_types import Array, Floats, Mask, Reals, Triangles, Whole
from glsim.core.mesh import vertex_normals
from glsim.core.products import nearest_rotation, product
from glsim.looks.shapes import Shape
from glsim.looks.skin_grid import Anchors, SkinGrid, point_normals

Points = Floats

#: A skull is still if no point moves by this much, mm. Chosen: far below any sensor's step.
_REST_MM = 0.02
#: Number of rings of skin triangles that are drawn under the edge of a shell, because a camera can
#: look in there. The base of a shell is one ring wider than the shell. The value was chosen.
_RIM_RINGS = 6


class Motion(NamedTuple):
    """The rigid motion of a skull from the reference to a frame: x -> x rotation^T + shift."""

    rotation: Floats
    shift: Floats
    is_rest: bool = False

    def equals(self, other: Motion) -> bool:
        """Return whether two motions have exactly equal rotations and shifts."""
        return all(map(np.array_equal, self[:2], other[:2]))

    def turned(self, offsets: Points) -> Points:
        """Rotate offsets (N, 3) with the skull; without rotation return the same array."""
        return offsets if self.is_rest else product(offsets, self.rotation.T)


def skull_motion(reference: Points, moved: Points) -> Motion:
    """Fit rotation and shift between two sets of points, (N, 3), by least squares (Kabsch).

    It is the identity if no point moved by _REST_MM: raised brows move the scalp's edge by less.
    """
    first, second = reference.mean(axis=0), moved.mean(axis=0)
    if np.abs(moved - reference).max() < _REST_MM:
        return Motion(np.eye(3, dtype=np.float32), np.zeros(3, np.float32), True)
    both = moved - second, reference - first
    here, there = (np.ascontiguousarray(points.T, np.float64) for points in both)
    rotation = nearest_rotation((here[:, None] * there).sum(axis=2)).astype(np.float32)
    return Motion(rotation, (second - product(rotation, first)).astype(np.float32))


class Binding(Protocol):
    """The protocol of a mesh that the vertices ``used`` of a face's mesh move."""

    used: Whole

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Compute the mesh's vertices (N, 3) float32 from a frame's face vertices (V, 3), mm."""
        ...


class Rooted:
    """A hair mesh: each vertex keeps its offset from a root on the skin, rotated with the skull."""

    def __init__(self, roots: Anchors, root_of: Whole, offsets_mm: Reals) -> None:
        """Bind hair vertices to roots by (N,) indices of roots and (N, 3) offsets at rest, mm."""
        self.used, corners = np.unique(roots.corners, return_inverse=True)
        self._roots = Anchors(corners.reshape(-1, 3), roots.weights)
        self._root_of, self._offsets = root_of, offsets_mm.astype(np.float32)

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Compute the hair's vertices (N, 3) from the face's vertices of a frame, mm."""
        points = self._roots.place(vertices_mm[self.used])[self._root_of]
        return points + motion.turned(self._offsets)


class Rigid:
    """An object that moves rigidly with the skull, such as glasses."""

    used = np.zeros(0, np.int64)

    def __init__(self, shape: Shape) -> None:
        """Store the mesh of an object, placed on the subject's resting head."""
        self.points_mm = shape.vertices_mm.astype(np.float32)

    def place(self, _vertices_mm: Points, motion: Motion) -> Points:
        """Move the points (N, 3) with the skull, mm."""
        return product(self.points_mm, motion.rotation.T) + motion.shift


class Shell:
    """A layer over a subject's skin: each grid point keeps its offset from a nearby triangle."""

    def __init__(
        self, grid: SkinGrid, rest_mm: Reals, offset_mm: Reals, drop_mm: Points | None = None
    ) -> None:
        """Bind a layer to the skin of a resting head (V, 3) mm by the offset of each grid point.

        ``offset_mm``: (N,) along the skin's smooth normals, or (N, 3) in canonical axes;
        ``drop_mm`` (N, 3): a further offset that rotates with the skull, not with the skin.
        """
        self.used, self.faces = grid.base, np.ascontiguousarray(grid.faces, np.int32)
        drop = np.zeros((1, 3), np.float32) if drop_mm is None else drop_mm
        self._dropped = np.flatnonzero(drop.any(axis=1))
        self._drop = drop[self._dropped]
        skin = rest_mm[grid.base].astype(np.float64)
        flat = offset_mm.ndim == 1
        offset = point_normals(grid, skin) * offset_mm[:, None] if flat else offset_mm
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
        """Compute the layer's vertices (N, 3) from the face's vertices of a frame, mm."""
        skin = np.ascontiguousarray(vertices_mm[self.used].T)
        corners = [skin[:, corner] for corner in self._beside]
        points = corners[0].copy()
        first, second, third = self._corners
        between = skin[:, first] * self._weights[0]
        between += skin[:, second] * self._weights[1]
        between += skin[:, third] * self._weights[2]
        points[:, self._between] = between
        for share, axis in zip(self._shares, _axes(*corners), strict=True):
            points += share * axis
        placed = np.ascontiguousarray(points.T)
        placed[self._dropped] += motion.turned(self._drop)
        return placed


class Hair(NamedTuple):
    """Sheets of hair that move with the skin; ``faces`` to ``strands`` are those of ``Mesh``.

    ``light``: share of the light that reaches the strands, (N,) or one number.
    """

    binding: Binding
    faces: Triangles
    occluder: Triangles | None
    strands: Floats
    light: Array | float = 1.0


def _axes(a: Reals, b: Reals, c: Reals) -> tuple[Reals, Reals, Reals]:
    """Compute the axes of triangles, (3, N) unit vectors: along an edge, across it, normal."""
    # The axis of coordinates comes first, because NumPy is then several times faster.
    along = b - a
    along /= np.maximum(np.sqrt((along * along).sum(axis=0)), 1e-9)
    out = _crossed(along, c - a)
    out /= np.maximum(np.sqrt((out * out).sum(axis=0)), 1e-9)
    return along, _crossed(out, along), out


def _crossed(first: Reals, second: Reals) -> Reals:
    """Return the (3, N) cross products of (3, N) vectors."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return np.stack([first[i] * second[j] - first[j] * second[i] for i, j in pairs])


def uncovered(faces: Triangles, vertices: int, shells: Sequence[Shell]) -> Mask:
    """Mark the vertices of a mesh with (F, 3) triangles that no shell hides, (V,)."""
    corners, free = np.ascontiguousarray(faces.T), np.ones(vertices, bool)
    for shell in shells:
        seen, left = np.ones(vertices, bool), corners
        seen[shell.used] = False
        for _ in range(_RIM_RINGS):
            reached = seen[left].any(axis=0)
            seen[left[:, reached]] = True
            left = left[:, ~reached]
        free &= seen
    return free


def _beside(grid: SkinGrid, skin_mm: Array) -> Whole:
    """Find a skin triangle, (N, 3), at each grid point's nearest vertex, of most similar normal."""
    a, b, c = (skin_mm[grid.triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
    smooth = vertex_normals(skin_mm, grid.triangles)[grid.triangles]  # (T, 3, 3)
    flat = np.einsum("tki,ti->tk", smooth, facing)
    turned = np.stack([np.roll(grid.triangles, -k, axis=1) for k in range(3)], axis=1)
    order = np.argsort(flat.ravel(), kind="stable")  # the most similar one is written last
    best = np.zeros((len(skin_mm), 3), np.int64)
    best[grid.triangles.ravel()[order]] = turned.reshape(-1, 3)[order]
    row = np.arange(len(grid.anchors.corners))
    nearest = grid.anchors.corners[row, grid.anchors.weights.argmax(axis=1)]
    return np.asarray(best[nearest])
