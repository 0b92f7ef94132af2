"""Meshes that follow a head: rigid things, rooted hair, and shells over skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.scalp import Anchors

Points = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Motion:
    """The rigid motion of a skull from the reference to a frame: x -> x rotation^T + shift."""

    rotation: NDArray[np.float32]
    shift: NDArray[np.float32]

    def move(self, points: Points) -> Points:
        """Move (N, 3) points."""
        return points @ self.rotation.T + self.shift


def skull_motion(reference: Points, moved: Points) -> Motion:
    """Fit the rotation and shift between (N, 3) points by least squares (Kabsch)."""
    first, second = reference.mean(axis=0), moved.mean(axis=0)
    if np.array_equal(reference, moved):
        return Motion(np.eye(3, dtype=np.float32), np.zeros(3, np.float32))
    u, _, vt = np.linalg.svd((moved - second).astype(np.float64).T @ (reference - first))
    u[:, 2] *= np.sign(np.linalg.det(u @ vt))
    rotation = (u @ vt).astype(np.float32)
    return Motion(rotation, (second - rotation @ first).astype(np.float32))


@dataclass(frozen=True, eq=False)
class Rooted:
    """Hair: every vertex keeps its offset from a root on the skin, in the frame of the skull."""

    roots: Anchors
    offsets_mm: Points

    def place(self, vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) vertices over a mesh of the source."""
        return self.roots.place(vertices_mm) + self.offsets_mm @ motion.rotation.T


@dataclass(frozen=True, eq=False)
class Rigid:
    """A thing that moves with the skull, such as glasses. points_mm: (N, 3) on the reference."""

    points_mm: Points

    def place(self, _vertices_mm: Points, motion: Motion) -> Points:
        """Return the (N, 3) moved points."""
        return motion.move(self.points_mm)
