"""Pose of the face: the transform from canonical millimetres to camera metres."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

#: Canonical axes (y up, z out of the face) to camera axes (y down, z forward): a half turn about x.
_FACING = np.diag([1.0, -1.0, -1.0])


def pose_matrix(pose: Mapping[str, float]) -> NDArray[np.float32]:
    """(4, 4) float32 matrix, canonical mm to camera m.

    pose: distance_mm, x_mm, y_mm, yaw_deg, pitch_deg, roll_deg; missing entries are 0. The head
    rotates about its own origin: roll first, then pitch, then yaw. Positive angles turn it to its
    own left, raise it and tilt it to its own left.
    """
    yaw, pitch, roll = (np.radians(pose.get(f"{a}_deg", 0.0)) for a in ("yaw", "pitch", "roll"))
    rotation = _rotation(1, yaw) @ _rotation(0, -pitch) @ _rotation(2, -roll)
    matrix = np.eye(4)
    matrix[:3, :3] = _FACING @ rotation / 1000.0
    matrix[:3, 3] = [pose.get(n, 0.0) / 1000.0 for n in ("x_mm", "y_mm", "distance_mm")]
    return matrix.astype(np.float32)


def _rotation(axis: int, angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[j, j] = matrix[k, k] = c
    matrix[j, k], matrix[k, j] = -s, s
    return matrix
