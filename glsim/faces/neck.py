"""The neck of meshes with shoulders: the head turns, the shoulders stay; and random head motion.

Between head and shoulders, each vertex turns about the middle of the neck by a share of the angle.
This keeps the neck's thickness; a mean of two positions would make it thinner.

Motion in sequences of generated faces is a pure function of (seed of the sequence, time), smooth
and band-limited: each of the six numbers of a pose is a sum of sinusoids between 0.1 and 1.5 Hz
without a common period. At time 0 the motion is zero, so the first frame has the requested pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.products import norm, product
from glsim.core.seeds import rng_for
from glsim.core.units import MM_PER_M
from glsim.faces.performance import MOTION

#: Centre of rotation of head and neck, mm from the centre of the face: between the
#: atlanto-occipital joint (near (0, -25, -85) on the embedded heads) and the last cervical vertebra
#: (near (0, -140, -120)). Chosen, not measured.
NECK_PIVOT_MM: Final = (0.0, -80.0, -95.0)

#: Largest angles of the neck; the trunk turns by the rest. Chosen: about 60 % of the neck's active
#: range, which is 70-75 deg in rotation, 50-60 deg in flexion and 40-45 deg sideways (J. W. Youdas
#: et al., Phys. Ther. 72, 1992). People turn their shoulders before the end of the range.
NECK_DEG: Final = {"yaw_deg": 45.0, "pitch_deg": 32.0, "roll_deg": 26.0}

#: Lowest y of vertices that turn entirely with the head, as a function of z, mm: from the nape over
#: the throat to the chin of a wide open mouth.
HEAD_Z = (-160.0, -110.0, -60.0, -25.0, 20.0)
HEAD_Y = (-62.0, -88.0, -106.0, -150.0, -160.0)
NECK_MM = 72.0  # height over which the share falls from 1 to 0; the clavicles stay still

#: Components of the motion: number of the pose, largest amplitude, and band, Hz.
WAVES: Final = MOTION["heads"]["waves"]
_LEAST_SHARE: Final = 1 / 3


@dataclass(frozen=True, eq=False)
class Neck:
    """A description of a mesh's neck, which bends when the head turns against the shoulders.

    Args:
        head_share: function from vertices (N, 3), mm from the centre of the face, to (N,) shares of
            the head's turn: 1 head, 0 shoulders.
        face_mm: centre of the face in the frame of the mesh.
        trunk_poses: whether ``[pose]`` turns the whole person, so that only motion bends the neck;
            if not, the trunk stays upright as far as the neck can turn.
    """

    head_share: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    face_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    trunk_poses: bool = False


def head_share(vertices_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the share (N,) of the head's rotation at each vertex (N, 3): 1 head, 0 trunk."""
    share = np.ones(len(vertices_mm), np.float32)
    low = np.flatnonzero(vertices_mm[:, 1] < HEAD_Y[0])
    top = np.interp(vertices_mm[low, 2], HEAD_Z, HEAD_Y).astype(np.float32)
    t = np.clip((vertices_mm[low, 1] - top) / np.float32(NECK_MM) + np.float32(1.0), 0.0, 1.0)
    share[low] = t * t * (3.0 - 2.0 * t)
    return share


def pivot_mm(neck: Neck | None) -> NDArray[np.float64]:
    """Return the centre of the neck in the coordinate frame of the mesh, (3,) mm."""
    centre = np.zeros(3) if neck is None else np.asarray(neck.face_mm, np.float64)
    return centre + NECK_PIVOT_MM


def trunk_angles(pose: Mapping[str, float]) -> dict[str, float]:
    """Return the shoulders' yaw_deg, pitch_deg and roll_deg for the pose of a head."""
    return {
        name: pose.get(name, 0.0) - limit * float(np.tanh(pose.get(name, 0.0) / limit))
        for name, limit in NECK_DEG.items()
    }


def bend_neck(
    meshes: Sequence[Mesh], neck: Neck | None, pose: Mapping[str, float], still: Mapping[str, float]
) -> list[Mesh]:
    """Rotate the shoulders of a person's meshes back: ``pose_matrix(pose)`` turns the head only.

    ``still`` is the pose without its motion. Meshes that do not move are returned unchanged.
    """
    if neck is None:
        return [*meshes]
    trunk_pose = still if neck.trunk_poses else trunk_angles(pose)
    head, trunk = (
        MM_PER_M * pose_matrix({n: angles.get(n, 0.0) for n in NECK_DEG})[:3, :3].astype(np.float64)
        for angles in (pose, trunk_pose)
    )
    axis, angle = _axis_angle(product(head.T, trunk))
    return [*meshes] if angle == 0.0 else [_bent(mesh, neck, axis, angle) for mesh in meshes]


def _bent(mesh: Mesh, neck: Neck, axis: NDArray[np.float32], angle: float) -> Mesh:
    """Turn the shoulders of a mesh by an angle, rad, about a unit axis (3,)."""
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


def head_motion(seed: int, time_s: float) -> dict[str, float]:
    """Return offsets of a random head motion, three angles in deg, three shifts in mm; first 0."""
    rng = rng_for(seed, "head motion")
    share = rng.uniform(_LEAST_SHARE, 1.0, len(WAVES))
    in_band = rng.uniform(0.0, 1.0, len(WAVES))
    phase = rng.uniform(0.0, 2 * np.pi, len(WAVES))
    offsets = {name: 0.0 for name, *_ in WAVES}
    waves = zip(WAVES, share, in_band, phase, strict=True)
    for (name, most, low_hz, high_hz), s, x, start in waves:
        turn = 2 * np.pi * (low_hz + x * (high_hz - low_hz)) * time_s
        offsets[name] += float(most * s * (np.sin(turn + start) - np.sin(start)))
    return offsets


def move_pose(
    pose: Mapping[str, float], offsets: Mapping[str, float], neck: Neck | None = None
) -> dict[str, float]:
    """Return a pose with motion offsets added; angles turn the head about the centre of its neck.

    ``neck``: of the face; default: for a face at the origin.
    """
    turned = {
        name: value + (offsets.get(name, 0.0) if name.endswith("_deg") else 0.0)
        for name, value in pose.items()
    }
    pivot = np.append(pivot_mm(neck), 1.0)
    moved = (pose_matrix(pose) - pose_matrix(turned)).astype(np.float64)
    drift_mm = product(MM_PER_M * moved, pivot)
    for name, drift in zip(("x_mm", "y_mm", "distance_mm"), drift_mm, strict=False):
        turned[name] += float(drift) + offsets.get(name, 0.0)
    return turned
