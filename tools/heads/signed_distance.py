"""Signed distances of the template head: smooth unions of ellipsoids and capsules.

All functions take ``points`` (N, 3) in millimetres and return (N,) distances in millimetres,
negative inside. The head is left-right symmetric: volumes are defined for the subject's left
(x >= 0), and the caller passes ``|x|``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.core.products import product
from tools.heads.falloff import Array, Vec3

MAX_STEP_MM = 7.0  # longest step of a ray, so that it does not jump across a gap


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid that models a bone, a fat pad or a muscle; a hollow if ``carve`` is set.

    Args:
        center, radii: millimetres.
        pitch_deg: rotation about x; positive: front end down.
        yaw_deg: rotation about y; positive: front end towards +x.
        blend_mm: size of its joining fillet.
    """

    name: str
    center: Vec3
    radii: Vec3
    blend_mm: float
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    carve: bool = False


@dataclass(frozen=True)
class Capsule:
    """A tapered capsule: a ridge, an arch, a cord-like muscle (millimetres)."""

    name: str
    start: Vec3
    end: Vec3
    start_radius: float
    end_radius: float
    blend_mm: float
    carve: bool = False


Volume = Ellipsoid | Capsule


def rotation_matrix(pitch_deg: float, yaw_deg: float) -> Array:
    """Return the (3, 3) rotation from a volume's axes to the head's."""
    a, b = np.deg2rad(pitch_deg), np.deg2rad(yaw_deg)
    pitch = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    yaw = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return np.asarray(product(yaw, pitch), dtype=np.float64)


def ellipsoid_distance(points: Array, ellipsoid: Ellipsoid) -> Array:
    """Return the distance (N,) to an ellipsoid, exact to first order at its surface."""
    local = points - np.asarray(ellipsoid.center)
    if ellipsoid.pitch_deg or ellipsoid.yaw_deg:
        local = product(local, rotation_matrix(ellipsoid.pitch_deg, ellipsoid.yaw_deg))
    scaled = local / np.asarray(ellipsoid.radii)
    size = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))
    scaled /= np.asarray(ellipsoid.radii)
    slope = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))
    return np.asarray(size * (size - 1.0) / np.maximum(slope, 1e-9))


def capsule_distance(points: Array, capsule: Capsule) -> Array:
    """Return the distance (N,) to a tapered capsule."""
    start, axis = np.asarray(capsule.start), np.asarray(capsule.end) - np.asarray(capsule.start)
    local = points - start
    along = np.clip(product(local, axis) / (axis * axis).sum(), 0.0, 1.0)
    local -= along[:, None] * axis
    radius = capsule.start_radius + along * (capsule.end_radius - capsule.start_radius)
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", local, local)) - radius)


def smooth_min(a: Array, b: Array, blend_mm: float) -> Array:
    """Return the union of two distances with a quadratic fillet of about ``blend_mm``."""
    gap = np.maximum(blend_mm - np.abs(a - b), 0.0)
    return np.asarray(np.minimum(a, b) - gap * gap * (0.25 / blend_mm))


def smooth_max(a: Array, b: Array, blend_mm: float) -> Array:
    """Return the intersection of two distances with a fillet."""
    return -smooth_min(-a, -b, blend_mm)


def head_distance(points: Array, volumes: Sequence[Volume]) -> Array:
    """Return the distance (N,) to all volumes, joined or carved in order."""
    total = np.full(len(points), 1e3)
    for volume in volumes:
        part = (
            ellipsoid_distance(points, volume)
            if isinstance(volume, Ellipsoid)
            else capsule_distance(points, volume)
        )
        if volume.carve:
            total = smooth_max(total, -part, volume.blend_mm)
        else:
            total = smooth_min(total, part, volume.blend_mm)
    return total


def cast_to_surface(
    origins: Array, directions: Array, volumes: Sequence[Volume], steps: int = 30
) -> Array:
    """Trace rays from inside the head to the skin; return the (N, 3) points reached.

    Sphere tracing with short steps, because the distance inside an ellipsoid is approximate. Equal
    rays, as of both halves of the head, are traced once.

    Args:
        origins: (N, 3) inside the head.
        directions: (N, 3) unit.
    """
    rays, place = np.unique(np.hstack([origins, directions]), axis=0, return_inverse=True)
    origins, directions = rays[:, :3], rays[:, 3:]
    travelled = np.zeros(len(origins))
    for step in range(steps):
        gap = head_distance(origins + travelled[:, None] * directions, volumes)
        advance = -0.8 * gap if step < steps - 6 else -gap
        travelled = np.maximum(travelled + np.clip(advance, -2.0, MAX_STEP_MM), 0.0)
    return np.asarray((origins + travelled[:, None] * directions)[place])
