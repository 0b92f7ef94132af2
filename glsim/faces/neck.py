"""The neck of heads with shoulders: the head takes the pose, the shoulders stay upright.

A pose turns the head. Shoulders follow a head only where the neck cannot: small angles are the
neck's alone, beyond its comfortable range the trunk turns too. Between head and shoulders each
vertex turns by its share of the angle about the centre of the neck, which keeps its thickness (a
blend of two positions would make it thinner).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.head_motion import NECK_PIVOT_MM
from glsim.geometry.mesh import Mesh
from glsim.geometry.pose import pose_matrix

#: Vertices (N, 3) mm -> (N,) share of the head's pose that each follows: 1 head, 0 shoulders.
HeadShare = Callable[[NDArray[np.float32]], NDArray[np.float32]]

#: Angle that the neck approaches; the trunk takes the rest. Chosen: about 60 % of its active range,
#: 70-75 deg in rotation, 50-60 deg in flexion, 40-45 deg sideways (J. W. Youdas et al., Phys. Ther.
#: 72, 1992), as people turn their shoulders before the end of that range.
NECK_DEG: Final = {"yaw_deg": 45.0, "pitch_deg": 32.0, "roll_deg": 26.0}


def trunk_angles(pose: Mapping[str, float]) -> dict[str, float]:
    """Return yaw_deg, pitch_deg and roll_deg of the shoulders of a head in ``pose``."""
    return {
        name: pose.get(name, 0.0) - limit * float(np.tanh(pose.get(name, 0.0) / limit))
        for name, limit in NECK_DEG.items()
    }


def bend_neck(mesh: Mesh, pose: Mapping[str, float], head_share: HeadShare | None) -> Mesh:
    """Return the mesh with its shoulders turned back, to be drawn with ``pose_matrix(pose)``.

    head_share: of the source; None for a head without shoulders, which stays as it is.
    """
    if head_share is None:
        return mesh
    head, trunk = (
        1000.0 * pose_matrix(angles)[:3, :3].astype(np.float64)
        for angles in ({n: pose.get(n, 0.0) for n in NECK_DEG}, trunk_angles(pose))
    )
    axis, angle = _axis_angle(head.T @ trunk)
    if angle == 0.0:
        return mesh
    share = head_share(mesh.vertices_mm)
    moved = np.flatnonzero(share < 1.0)
    turn = np.float32(angle) * (1.0 - share[moved])
    cos, sin = np.cos(turn), np.sin(turn)
    vertices, pivot = mesh.vertices_mm.copy(), np.array(NECK_PIVOT_MM, np.float32)
    away = [vertices[moved, n] - pivot[n] for n in range(3)]
    along = (1.0 - cos) * (axis[0] * away[0] + axis[1] * away[1] + axis[2] * away[2])
    for n in range(3):  # Rodrigues' formula
        k, m = (n + 1) % 3, (n + 2) % 3
        across = axis[k] * away[m] - axis[m] * away[k]
        vertices[moved, n] = pivot[n] + cos * away[n] + sin * across + axis[n] * along
    return replace(mesh, vertices_mm=vertices)


def _axis_angle(rotation: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
    """Return the unit axis (3,) and the angle in radians of a (3, 3) rotation below 180 deg."""
    skew = 0.5 * (rotation - rotation.T)
    axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.zeros(3, np.float32), 0.0
    return (axis / sine).astype(np.float32), float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1)))
