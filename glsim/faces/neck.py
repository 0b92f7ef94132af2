"""The neck of people with shoulders: the head turns, the shoulders stay.

Between head and shoulders each vertex turns by its share of the angle about the middle of the neck,
which keeps its thickness (a blend of two positions would make it thinner).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.products import norm, product

#: Centre of rotation of head and neck, mm from the centre of the face: between the
#: atlanto-occipital joint (near (0, -25, -85) on the embedded heads) and the last cervical vertebra
#: (near (0, -140, -120)). Chosen.
NECK_PIVOT_MM: Final = (0.0, -80.0, -95.0)

#: Angle that the neck approaches; the trunk takes the rest. Chosen: about 60 % of its active range,
#: 70-75 deg in rotation, 50-60 deg in flexion, 40-45 deg sideways (J. W. Youdas et al., Phys. Ther.
#: 72, 1992), as people turn their shoulders before the end of that range.
NECK_DEG: Final = {"yaw_deg": 45.0, "pitch_deg": 32.0, "roll_deg": 26.0}

#: The lowest y that follows the head entirely, as a function of z (mm): from the nape over the
#: throat to the chin, whose lowest place is that of a wide open mouth.
HEAD_Z = (-160.0, -110.0, -60.0, -25.0, 20.0)
HEAD_Y = (-62.0, -88.0, -106.0, -150.0, -160.0)
NECK_MM = 72.0  # height over which the share falls from 1 to 0; the clavicles stay still


@dataclass(frozen=True, eq=False)
class Neck:
    """How a head turns against the shoulders of its mesh.

    Args:
        head_share: vertices (N, 3), mm from the centre of the face -> (N,) share of the head's turn
            that each follows: 1 head, 0 shoulders.
        face_mm: centre of the face in the frame of the mesh.
        trunk_poses: whether ``[pose]`` turns the whole person, so that only motion bends the neck;
            if not, the trunk stays upright as long as the neck can do the turn.
    """

    head_share: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    face_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    trunk_poses: bool = False


def head_share(vertices_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the share (N,) of the head's pose that each vertex (N, 3) follows: 1 head, 0 trunk."""
    share = np.ones(len(vertices_mm), np.float32)
    low = np.flatnonzero(vertices_mm[:, 1] < HEAD_Y[0])
    top = np.interp(vertices_mm[low, 2], HEAD_Z, HEAD_Y).astype(np.float32)
    t = np.clip((vertices_mm[low, 1] - top) / np.float32(NECK_MM) + np.float32(1.0), 0.0, 1.0)
    share[low] = t * t * (3.0 - 2.0 * t)
    return share


def pivot_mm(neck: Neck | None) -> NDArray[np.float64]:
    """Return the middle of the neck in the frame of the mesh, (3,) mm."""
    centre = np.zeros(3) if neck is None else np.asarray(neck.face_mm, np.float64)
    return centre + NECK_PIVOT_MM


def trunk_angles(pose: Mapping[str, float]) -> dict[str, float]:
    """Return yaw_deg, pitch_deg and roll_deg of the shoulders of a head in ``pose``."""
    return {
        name: pose.get(name, 0.0) - limit * float(np.tanh(pose.get(name, 0.0) / limit))
        for name, limit in NECK_DEG.items()
    }


def bend_neck(
    mesh: Mesh, neck: Neck | None, pose: Mapping[str, float], still: Mapping[str, float]
) -> Mesh:
    """Return the mesh with its shoulders turned back, to be drawn with ``pose_matrix(pose)``.

    Args:
        neck: None for a head without shoulders, which stays as it is.
        pose: of the head, after its motion.
        still: before it.
    """
    if neck is None:
        return mesh
    trunk_pose = still if neck.trunk_poses else trunk_angles(pose)
    head, trunk = (
        1000.0 * pose_matrix({n: angles.get(n, 0.0) for n in NECK_DEG})[:3, :3].astype(np.float64)
        for angles in (pose, trunk_pose)
    )
    axis, angle = _axis_angle(product(head.T, trunk))
    if angle == 0.0:
        return mesh
    share = neck.head_share(mesh.vertices_mm - np.asarray(neck.face_mm, np.float32))
    moved = np.flatnonzero(share < 1.0)
    if not len(moved):
        return mesh
    turn = np.float32(angle) * (1.0 - share[moved])
    cos, sin = np.cos(turn), np.sin(turn)
    vertices, pivot = mesh.vertices_mm.copy(), pivot_mm(neck).astype(np.float32)
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
    sine = norm(axis)
    if sine < 1e-9:
        return np.zeros(3, np.float32), 0.0
    return (axis / sine).astype(np.float32), float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1)))
