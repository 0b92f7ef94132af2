"""Pose of the face: the transform from canonical millimetres to camera-frame metres."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from glsim.core.array_types import Array, Floats
from glsim.core.products import product
from glsim.core.units import MM_PER_M

#: Canonical axes (y up, z out of the face) to camera axes (y down, z forward): a half turn about x.
_FACING = np.diag([1.0, -1.0, -1.0])


def pose_matrix(pose: Mapping[str, float]) -> Floats:
    """Compute the (4, 4) float32 matrix from canonical millimetres to camera-frame metres.

    The head rotates about the origin of its frame: first roll, then pitch, then yaw. Positive yaw
    turns it to its own left, positive pitch raises it, positive roll tilts it to its own left. The
    keys are distance_mm, x_mm, y_mm, yaw_deg, pitch_deg, roll_deg; a missing one counts as 0.
    """
    turn = rotation(*(pose.get(f"{angle}_deg", 0.0) for angle in ("yaw", "pitch", "roll")))
    matrix = np.eye(4)
    matrix[:3, :3] = product(_FACING, turn) / MM_PER_M
    matrix[:3, 3] = [pose.get(n, 0.0) / MM_PER_M for n in ("x_mm", "y_mm", "distance_mm")]
    return matrix.astype(np.float32)


def rotation(yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Array:
    """Compute the (3, 3) rotation of a head that is tilted left, then raised, then turned left."""
    yaw, pitch, roll = np.radians(yaw_deg), np.radians(pitch_deg), np.radians(roll_deg)
    return product(product(_about(1, yaw), _about(0, -pitch)), _about(2, -roll))


def _about(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[j, j] = matrix[k, k] = c
    matrix[j, k], matrix[k, j] = -s, s
    return matrix
