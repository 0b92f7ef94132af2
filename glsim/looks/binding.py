"""Meshes that follow a head: rigid things, rooted hair, and shells over skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.core.products import nearest_rotation, product
from glsim.looks.skin_grid import Anchors

Points = NDArray[np.float32]

#: A skull whose points move by less than this rests, mm; chosen, far below any sensor's step.
_REST_MM = 0.02


@dataclass(frozen=True, eq=False)
class Motion:
    """The rigid motion of a skull from the reference to a frame: x -> x rotation^T + shift."""

    rotation: NDArray[np.float32]
    shift: NDArray[np.float32]
    is_rest: bool = False

    def __eq__(self, other: object) -> bool:
        """Whether two motions are the same, to the last bit."""
        return (
            isinstance(other, Motion)
            and np.array_equal(self.rotation, other.rotation)
            and np.array_equal(self.shift, other.shift)
        )

    def move(self, points: Points) -> Points:
        """Move (N, 3) points."""
        return product(points, self.rotation.T) + self.shift


def skull_motion(reference: Points, moved: Points) -> Motion:
    """Fit the rotation and shift between (N, 3) points by least squares (Kabsch).

    A skull at rest, up to the ends of what raised brows move, has no motion at all.
    """
    first, second = reference.mean(axis=0), moved.mean(axis=0)
    if np.abs(moved - reference).max() < _REST_MM:
        return Motion(np.eye(3, dtype=np.float32), np.zeros(3, np.float32), True)
    here, there = (
        np.ascontiguousarray(p.T, np.float64) for p in (moved - second, reference - first)
    )
    rotation = nearest_rotation((here[:, None] * there).sum(axis=2)).astype(np.float32)
    return Motion(rotation, (second - product(rotation, first)).astype(np.float32))


class Binding(Protocol):
    """A mesh that follows the mesh of a source.

    Args:
        used: the vertices that it follows.
    """

    used: NDArray[np.int64]

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) float32 points over the (V, 3) vertices of a frame."""
        ...


class Rooted:
    """Hair: every vertex keeps its offset from a root on the skin, in the frame of the skull."""

    def __init__(
        self, roots: Anchors, root_of: NDArray[np.int64], offsets_mm: NDArray[np.floating[Any]]
    ) -> None:
        """Bind vertices to the skin.

        Args:
            roots: points on the skin.
            root_of: (N,) index of each vertex's root.
        """
        self.used, corners = np.unique(roots.corners, return_inverse=True)
        self._roots = Anchors(corners.reshape(-1, 3), roots.weights)
        self._root_of, self._offsets = root_of, offsets_mm.astype(np.float32)

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) vertices over a mesh of the source."""
        points = self._roots.place(vertices_mm[self.used])[self._root_of]
        points += self._offsets if motion.is_rest else product(self._offsets, motion.rotation.T)
        return points


class Rigid:
    """A thing that moves with the skull, such as glasses."""

    used = np.zeros(0, np.int64)

    def __init__(self, points_mm: Points) -> None:
        """points_mm: (N, 3) on the subject's head at rest."""
        self.points_mm = points_mm

    def place(self, _vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) moved points."""
        return motion.move(self.points_mm)
