"""Clay for the template head: signed distances of soft volumes, joined smoothly.

Everything works on ``points`` of shape (N, 3) in millimetres and gives (N,) distances in
millimetres, negative inside. The head is left-right symmetric, so every volume is written for the
subject's left (x >= 0) and the caller passes ``|x|``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int32]
Vec3 = tuple[float, float, float]
LONGEST_STEP_MM = 7.0  # rays may not jump across a gap wider than this


@dataclass(frozen=True)
class Blob:
    """An ellipsoid: a bone, a fat pad, a muscle belly; or a hollow where ``carve`` is set.

    center, radii: millimetres. pitch_deg turns it about x (positive: front end down),
    yaw_deg about y (positive: front end towards +x). blend_mm: how softly it joins the rest.
    """

    name: str
    center: Vec3
    radii: Vec3
    blend_mm: float
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    carve: bool = False


@dataclass(frozen=True)
class Bar:
    """A tapered rod with round ends: a ridge, an arch, a cord-like muscle (millimetres)."""

    name: str
    start: Vec3
    end: Vec3
    start_radius: float
    end_radius: float
    blend_mm: float
    carve: bool = False


Volume = Blob | Bar


def turn_matrix(pitch_deg: float, yaw_deg: float) -> Array:
    """The (3, 3) rotation that takes a volume's own axes to the head's."""
    a, b = np.deg2rad(pitch_deg), np.deg2rad(yaw_deg)
    pitch = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    yaw = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return np.asarray(yaw @ pitch, dtype=np.float64)


def blob_distance(points: Array, blob: Blob) -> Array:
    """Distance (N,) to an ellipsoid, first-order exact at its surface."""
    local = points - np.asarray(blob.center)
    if blob.pitch_deg or blob.yaw_deg:
        local = local @ turn_matrix(blob.pitch_deg, blob.yaw_deg)
    scaled = local / np.asarray(blob.radii)
    size = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))
    scaled /= np.asarray(blob.radii)
    slope = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))
    return np.asarray(size * (size - 1.0) / np.maximum(slope, 1e-9))


def bar_distance(points: Array, bar: Bar) -> Array:
    """Distance (N,) to a rod whose radius changes evenly from end to end."""
    start, axis = np.asarray(bar.start), np.asarray(bar.end) - np.asarray(bar.start)
    local = points - start
    along = np.clip(local @ axis / (axis @ axis), 0.0, 1.0)
    local -= along[:, None] * axis
    radius = bar.start_radius + along * (bar.end_radius - bar.start_radius)
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", local, local)) - radius)


def smooth_min(a: Array, b: Array, blend_mm: float) -> Array:
    """The union of two distances with a fillet of about ``blend_mm`` (quadratic)."""
    gap = np.maximum(blend_mm - np.abs(a - b), 0.0)
    return np.asarray(np.minimum(a, b) - gap * gap * (0.25 / blend_mm))


def smooth_max(a: Array, b: Array, blend_mm: float) -> Array:
    """The intersection of two distances, or the higher of two reliefs, with a fillet."""
    return -smooth_min(-a, -b, blend_mm)


def sculpture_distance(points: Array, volumes: Sequence[Volume]) -> Array:
    """Distance (N,) to all volumes, joined (or carved) in their order."""
    total = np.full(len(points), 1e3)
    for volume in volumes:
        part = (
            blob_distance(points, volume)
            if isinstance(volume, Blob)
            else bar_distance(points, volume)
        )
        if volume.carve:
            total = smooth_max(total, -part, volume.blend_mm)
        else:
            total = smooth_min(total, part, volume.blend_mm)
    return total


def cast_to_surface(
    origins: Array, directions: Array, volumes: Sequence[Volume], steps: int = 30
) -> Array:
    """Walk (N,) rays from inside the head to the skin; gives the (N, 3) points reached.

    origins: (N, 3) inside the head; directions: (N, 3) unit. Sphere tracing with short steps,
    because the distance inside an ellipsoid is only a guess.
    """
    travelled = np.zeros(len(origins))
    for step in range(steps):
        gap = sculpture_distance(origins + travelled[:, None] * directions, volumes)
        advance = -0.8 * gap if step < steps - 6 else -gap
        travelled = np.maximum(travelled + np.clip(advance, -2.0, LONGEST_STEP_MM), 0.0)
    return np.asarray(origins + travelled[:, None] * directions)


def smoothstep(low: Array | float, high: Array | float, value: Array) -> Array:
    """0 below ``low``, 1 above ``high``, a smooth S between (works with low > high too)."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def bump(offset: Array, width: float) -> Array:
    """exp(-(offset/width)^2): 1 at 0, 0.37 at ``width``, 0.02 at twice ``width``."""
    return np.asarray(np.exp(-np.square(offset / width)))
