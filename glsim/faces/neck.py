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
    vertices, pivot = mesh.vertices_mm.copy(), np.array(NECK_PIVOT_MM, np.float32)
    for moved, turn in (
        (np.flatnonzero(share == 0.0), np.float32(angle)),
        (neck := np.flatnonzero((share > 0.0) & (share < 1.0)), angle * (1.0 - share[neck, None])),
    ):
        vertices[moved] = pivot + _turned(vertices[moved] - pivot, axis, turn)
    return replace(mesh, vertices_mm=vertices)


def _turned(
    away: NDArray[np.float32], axis: NDArray[np.float32], angle: NDArray[np.float32] | np.float32
) -> NDArray[np.float32]:
    """Return points (N, 3) turned about an axis by angles, (N, 1) or one (Rodrigues' formula)."""
    x, y, z = axis
    across = np.array(
        [[0, z, -y], [-z, 0, x], [y, -x, 0]], np.float32
    )  # away @ across: axis x away
    along = away @ np.outer(axis, axis)
    turned = along + np.cos(angle) * (away - along) + np.sin(angle) * (away @ across)
    return np.asarray(turned, np.float32)


def _axis_angle(rotation: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
    """Return the unit axis (3,) and the angle in radians of a (3, 3) rotation below 180 deg."""
    skew = 0.5 * (rotation - rotation.T)
    axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.zeros(3, np.float32), 0.0
    return (axis / sine).astype(np.float32), float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1)))
