"""Scenes for the validation of sensors: meshes in the camera frame (x right, y down), mm."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glsim.faces.base import Face
from glsim.faces.procedural.source import ProceduralFaces
from glsim.geometry.mesh import Mesh

#: Slant of the edge of ``depth_edge``, columns per row: the edge moves by one pixel about every
#: 11 rows, so that it crosses pixels at all positions.
EDGE_SLANT = 0.09


def quad(corners_mm: ArrayLike, albedo: float = 1.0) -> Mesh:
    """Build a quad from (4, 3) corners: bottom left, bottom right, top right, top left in view."""
    corners = np.asarray(corners_mm, np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(corners, faces, np.full(4, albedo, np.float32))


def merge_meshes(*meshes: Mesh) -> Mesh:
    """Merge meshes with albedos into one."""
    starts = np.cumsum([0] + [len(m.vertices_mm) for m in meshes[:-1]])
    return Mesh(
        np.concatenate([m.vertices_mm for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]).astype(np.int32),
        np.concatenate([np.asarray(m.albedo, np.float32) for m in meshes]),
    )


def rectangle(
    x_mm: tuple[float, float], y_mm: tuple[float, float], z_mm: float, albedo: float = 1.0
) -> Mesh:
    """Build a rectangle that faces the camera."""
    (left, right), (top, bottom) = x_mm, y_mm
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    return quad([(x, y, z_mm) for x, y in corners], albedo)


def wall(z_mm: float, albedo: float = 1.0) -> Mesh:
    """Build a wall that faces the camera and fills its view."""
    side = 1.2 * z_mm
    return rectangle((-side, side), (-side, side), z_mm, albedo)


def tilted(z_mm: float, angle_deg: float, albedo: float = 1.0, half_mm: float = 300.0) -> Mesh:
    """Build a strip through the axis at z, turned about the x axis: its top is nearer.

    An emitter to the side of the camera lights it at the angle at which the camera sees it.
    """
    angle = np.radians(angle_deg)
    y, z = half_mm * np.cos(angle), half_mm * np.sin(angle)
    x = 0.5 * z_mm
    far, near = z_mm + z, z_mm - z
    return quad([(-x, y, far), (x, y, far), (x, -y, near), (-x, -y, near)], albedo)


def depth_ramp(z_mm: float, half_x_mm: float, half_range_mm: float, albedo: float = 1.0) -> Mesh:
    """Build a wall whose depth grows from left to right, z - half_range_mm to z + half_range_mm.

    It leans a little, so that the rows have different depths.
    """
    x, y, dz = half_x_mm, 0.8 * z_mm, half_range_mm
    low, high, lean = z_mm - dz, z_mm + dz, 0.1 * dz
    bottom, top = (
        [(-x, y, low + lean), (x, y, high + lean)],
        [(x, -y, high - lean), (-x, -y, low - lean)],
    )
    return quad([*bottom, *top], albedo)


def levels_on_ramp(encoded: NDArray[np.uint16]) -> int:
    """Count the different depths on ``ten_centimetres``, in whole mm: 101 if none is missing."""
    inside = encoded[(encoded >= 2950) & (encoded <= 3050)]
    return len(np.unique(inside))


def ten_centimetres(focal_px: float) -> Mesh:
    """Build a depth ramp of 12 cm at 3 m, over 88 px; 10 cm of it are evaluated."""
    return depth_ramp(3000.0, 44 * 3000.0 / focal_px, 60.0)


def albedo_ramp(z_mm: float, half_x_mm: float, low: float, high: float) -> Mesh:
    """Build a wall whose albedo grows linearly from left to right over +-half_x."""
    mesh = rectangle((-half_x_mm, half_x_mm), (-0.8 * z_mm, 0.8 * z_mm), z_mm)
    return Mesh(mesh.vertices_mm, mesh.faces, np.array([low, high, high, low], np.float32))


def depth_edge(near_mm: float, far_mm: float | None, albedo: float = 1.0) -> Mesh:
    """Build a foreground on the left of the axis with a slanted edge, before a wall or nothing.

    The emitter is on the right, so the foreground hides its own shadow: the edge is fully lit.
    """
    y = 0.8 * near_mm
    x = EDGE_SLANT * y
    left = -1.2 * near_mm
    front = quad([(left, y, near_mm), (x, y, near_mm), (-x, -y, near_mm), (left, -y, near_mm)],
                 albedo)  # fmt: skip
    return front if far_mm is None else merge_meshes(front, wall(far_mm, albedo))


def occluder(near_mm: float, far_mm: float, half_mm: float, albedo: float = 1.0) -> Mesh:
    """Build a square on the axis before a wall."""
    square = rectangle((-half_mm, half_mm), (-half_mm, half_mm), near_mm, albedo)
    return merge_meshes(square, wall(far_mm, albedo))


def faces(count: int, z_mm: float, seed: int) -> list[Mesh]:
    """Build procedural heads of ``count`` people at z, all with the default skin albedo."""
    source = ProceduralFaces(seed)
    keys = [source.frames(subject, 1)[0] for subject in source.subjects(count)]
    meshes = []
    for face in source.load(keys):
        assert isinstance(face, Face)
        vertices = face.mesh.vertices_mm * np.array([1, -1, -1], np.float32)
        meshes.append(Mesh(vertices + np.array([0, 0, z_mm], np.float32), face.mesh.faces))
    return meshes
