"""Scenes that validation and fits capture: meshes in the camera frame (x right, y down), mm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from glsim.core.depth_map import grid_triangles
from glsim.core.mesh import Mesh
from glsim.faces.face_source import Face
from glsim.faces.sources.procedural import ProceduralFaces
from glsim.looks.dress import Dresser
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import AppearanceSettings
from glsim.settings.toml_tables import read_toml

#: Focal length times baseline of the D435 whose real frames show the room corner, px mm.
_FOCAL_BASELINE_PX_MM = 626_823 / 32
#: Albedos with which infrared equals the real frame's: 6,000 to 12,000 counts on the mug, 500 to
#: 700 counts on the walls.
_MUG_ALBEDO, _HANDLE_ALBEDO, _WALL_ALBEDO, _SIDE_ALBEDO = 0.5, 0.55, 0.8, 1.0
#: Albedo of bars: the median over all foregrounds with a shadow in real frames.
_BAR_ALBEDO = 0.3
#: Slant of the edge of ``depth_edge``, columns per row. The edge moves by one column in 11 rows, so
#: that it crosses pixels at every sub-pixel position.
_EDGE_SLANT = 0.09


def quad(corners_mm: ArrayLike, albedo: float = 1.0) -> Mesh:
    """Build a quad from (4, 3) corners: bottom left, bottom right, top right, top left in view."""
    corners = np.asarray(corners_mm, np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(corners, faces, np.full(4, albedo, np.float32))


def merge_meshes(*meshes: Mesh) -> Mesh:
    """Merge meshes with albedos into one mesh."""
    starts = np.cumsum([0] + [len(m.vertices_mm) for m in meshes[:-1]])
    return Mesh(
        np.concatenate([m.vertices_mm for m in meshes]),
        np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]).astype(np.int32),
        np.concatenate([np.asarray(m.albedo, np.float32) for m in meshes]),
    )


def rectangle(
    x_mm: tuple[float, float], y_mm: tuple[float, float], z_mm: float | tuple[float, float],
    albedo: float = 1.0,
) -> Mesh:  # fmt: skip
    """Build an upright rectangle: left and right, top and bottom, depth of both sides or each."""
    (left, right), (top, bottom) = x_mm, y_mm
    first, second = np.broadcast_to(z_mm, 2).tolist()
    below = [(left, bottom, first), (right, bottom, second)]
    return quad([*below, (right, top, second), (left, top, first)], albedo)


def wall(z_mm: float, albedo: float = 1.0) -> Mesh:
    """Build a frontal wall that fills the camera's view."""
    side = 1.2 * z_mm
    return rectangle((-side, side), (-side, side), z_mm, albedo)


def tilted(z_mm: float, angle_deg: float, albedo: float = 1.0, half_mm: float = 300.0) -> Mesh:
    """Build a strip on the optical axis, turned about the x axis so that its top is nearer.

    An emitter beside the camera lights the strip at the angle at which the camera sees it: the
    angle between the strip's normal and the optical axis. ``z_mm``: depth of the middle;
    ``half_mm``: half the strip's height.
    """
    angle = np.radians(angle_deg)
    y, z = half_mm * np.cos(angle), half_mm * np.sin(angle)
    x = 0.5 * z_mm
    far, near = z_mm + z, z_mm - z
    return quad([(-x, y, far), (x, y, far), (x, -y, near), (-x, -y, near)], albedo)


def depth_ramp(z_mm: float, half_x_mm: float, half_range_mm: float) -> Mesh:
    """Build a wall whose depth grows from z - half_range_mm (left) to z + half_range_mm (right).

    The wall leans a little, so that each row has other depths.
    """
    x, y, dz = half_x_mm, 0.8 * z_mm, half_range_mm
    low, high, lean = z_mm - dz, z_mm + dz, 0.1 * dz
    bottom = [(-x, y, low + lean), (x, y, high + lean)]
    return quad([*bottom, (x, -y, high - lean), (-x, -y, low - lean)])


def albedo_ramp(z_mm: float, half_x_mm: float, low: float, high: float) -> Mesh:
    """Build a wall whose albedo grows linearly from left to right, from -half_x_mm to half_x_mm."""
    mesh = rectangle((-half_x_mm, half_x_mm), (-0.8 * z_mm, 0.8 * z_mm), z_mm)
    return Mesh(mesh.vertices_mm, mesh.faces, np.array([low, high, high, low], np.float32))


def depth_edge(near_mm: float, far_mm: float) -> Mesh:
    """Build a foreground with a slanted edge, left of the optical axis and in front of a wall.

    The emitter is on the right. The camera does not see the foreground's shadow, so that the wall
    is lit up to the edge.
    """
    return merge_meshes(_slanted_bar(-1.2 * near_mm, 0.0, near_mm), wall(far_mm))


def occluder(near_mm: float, far_mm: float, half_mm: float, albedo: float = 1.0) -> Mesh:
    """Build the mesh of a square target before a wall; its side is 2 ``half_mm``, on the axis."""
    square = rectangle((-half_mm, half_mm), (-half_mm, half_mm), near_mm, albedo)
    return merge_meshes(square, wall(far_mm, albedo))


def bars(near_mm: float, far_mm: float, albedo: float) -> Mesh:
    """Build six slanted bars in front of a wall; a bar is as wide as a tenth of its distance."""
    lefts = np.arange(-0.72, 0.7, 0.26) * near_mm
    fronts = [_slanted_bar(x, x + 0.1 * near_mm, near_mm, _BAR_ALBEDO) for x in lefts]
    return merge_meshes(*fronts, wall(far_mm, albedo))


def _slanted_bar(left_mm: float, right_mm: float, z_mm: float, albedo: float = 1.0) -> Mesh:
    """Build a slanted bar at depth z; at the image's middle row it reaches from left to right."""
    y, lean = 0.8 * z_mm, _EDGE_SLANT * 0.8 * z_mm
    ends = [(left_mm + lean, y), (right_mm + lean, y), (right_mm - lean, -y), (left_mm - lean, -y)]
    return quad([(*end, z_mm) for end in ends], albedo)


def faces(count: int, z_mm: float, seed: int, wear: Literal["always", "never"]) -> list[list[Mesh]]:
    """Build procedural heads, each a mesh of skin and the meshes of what the person wears.

    Their origin is at ``z_mm``. ``wear``: whether all people wear hair and clothes, or none.
    """
    source = ProceduralFaces(seed)
    keys = [source.frames(subject, 1)[0] for subject in source.subjects(count)]
    dresser = Dresser(source, AppearanceSettings(wear=wear))
    heads = []
    for number, face in enumerate(source.load(keys)):
        assert isinstance(face, Face)
        worn = dresser.dress(face, ScopeSeeds(number, number, number))
        meshes = [replace(worn.mesh, occluder=None), *(part.mesh for part in worn.parts)]
        signs, shift = np.array([1, -1, -1], np.float32), np.array([0, 0, z_mm], np.float32)
        heads.append([replace(m, vertices_mm=m.vertices_mm * signs + shift) for m in meshes])
    return heads


def room_corner(focal_baseline_px_mm: float = _FOCAL_BASELINE_PX_MM) -> Mesh:
    """Build a simple model of the room corner in two real frames of a D435.

    A wall at 1.75 m, a board that recedes on the right from 0.35 to 1.6 m, a bag in the corner, a
    dark backpack, a box on the floor, and a frame on the board. The scene is scaled with focal
    length times baseline, so that all cameras see 11 px of disparity on the wall, up to 98 px on
    the board.
    """
    table = read_toml(Path(__file__).with_name("room_corner.toml"))["rectangles"]
    mesh = merge_meshes(*(rectangle(x, y, z, albedo) for x, y, z, albedo in table))
    scale = np.float32(focal_baseline_px_mm / _FOCAL_BASELINE_PX_MM)
    return Mesh(mesh.vertices_mm * scale, mesh.faces, mesh.albedo)


def mug_before_walls() -> Mesh:
    """Build a simple model of an Azure Kinect's real frame: a mug before walls.

    Distances are read from the frame: the mug is at 0.26 m, its handle at 0.3 m. On the left, 0.38
    m beside the camera, a side wall recedes; the back wall is at 1.55 m.
    """
    mug = _cylinder((-71.0, 303.0), 41.0, (-18.0, 88.0), _MUG_ALBEDO)
    handle = _cylinder((2.0, 306.0), 6.0, (5.0, 75.0), _HANDLE_ALBEDO)
    left = rectangle((-378, -378), (-900, 900), (500, 1550), _SIDE_ALBEDO)
    back = rectangle((-378, 1500), (-900, 900), 1550, _WALL_ALBEDO)
    return merge_meshes(mug, handle, left, back)


def _cylinder(
    axis_mm: tuple[float, float], radius_mm: float, rows_mm: tuple[float, float], albedo: float
) -> Mesh:
    """Build the side surface of an upright cylinder from (x, z) of its axis and (top, bottom) y."""
    turn = np.linspace(0.0, 2.0 * np.pi, 97)
    x = axis_mm[0] + radius_mm * np.sin(turn)
    z = axis_mm[1] - radius_mm * np.cos(turn)
    rings = [np.column_stack([x, np.full_like(x, row), z]) for row in rows_mm]
    vertices = np.concatenate(rings).astype(np.float32)
    triangles = grid_triangles((2, len(turn)))
    return Mesh(vertices, triangles, np.full(len(vertices), albedo, np.float32))
