"""Shapes of things: rounded boxes, bodies of revolution, rods, tubes, sheets and plates.

Axes are those of the canonical face frame: millimetres, +x to the right in the image, +y up, +z
towards the camera. All triangles are counter-clockwise seen from outside.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from glsim.core.array_types import Array, Reals, Triangles
from glsim.core.products import norm, product
from glsim.looks.skin_grid import grid_triangles

Points = Array


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh with one albedo at 860 nm, relative to a white wall, and one region."""

    vertices_mm: Points
    faces: Triangles
    albedo: float = 0.8
    region: str = "furniture"

    def moved(
        self, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, turn_deg: float = 0.0
    ) -> Shape:
        """Return the shape rotated about the vertical axis, +z towards +x, then shifted, mm."""
        return replace(self, vertices_mm=turned(self.vertices_mm, turn_deg) + np.array([x, y, z]))

    def leaned(self, degrees: float) -> Shape:
        """Return the shape leaned back: rotated about the x axis, the top towards -z."""
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        x, y, z = self.vertices_mm.T
        return replace(self, vertices_mm=np.stack([x, c * y + s * z, c * z - s * y], axis=1))


def turned(points_mm: Points, degrees: float) -> Points:
    """Rotate (N, 3) points about the vertical axis; positive angles turn +z towards +x."""
    if degrees == 0.0:
        return points_mm
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.asarray(product(points_mm, np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])))


def moved(
    shapes: Iterable[Shape], x: float = 0.0, y: float = 0.0, z: float = 0.0, turn_deg: float = 0.0
) -> list[Shape]:
    """Rotate and shift several shapes together; arguments as in ``Shape.moved``."""
    return [shape.moved(x, y, z, turn_deg=turn_deg) for shape in shapes]


def bounds_mm(shapes: Iterable[Shape]) -> tuple[Points, Points]:
    """Return the lower and the upper corner of the bounding box, (3,) each."""
    boxes = [(s.vertices_mm.min(axis=0), s.vertices_mm.max(axis=0)) for s in shapes]
    return np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)


def joined(shapes: Sequence[Shape]) -> Shape:
    """Join shapes into one shape with the albedo and the region of the first."""
    starts = np.cumsum([0, *(len(s.vertices_mm) for s in shapes)])
    faces = [shape.faces + start for shape, start in zip(shapes, starts, strict=False)]
    vertices = np.concatenate([shape.vertices_mm for shape in shapes])
    return replace(shapes[0], vertices_mm=vertices, faces=np.concatenate(faces).astype(np.int32))


def mirrored(shape: Shape, axis: int) -> Shape:
    """Mirror a shape along axis 0, 1 or 2."""
    vertices = shape.vertices_mm.copy()
    vertices[:, axis] *= -1
    return replace(shape, vertices_mm=vertices, faces=shape.faces[:, ::-1])


def box(
    size_mm: ArrayLike, at_mm: ArrayLike = (0.0, 0.0, 0.0), albedo: float = 0.8, *,
    edge_mm: float = 0.0, cells: int = 3, plump_mm: float = 0.0, region: str = "furniture",
) -> Shape:  # fmt: skip
    """Make a box with rounded edges.

    Args:
        size_mm, at_mm: width, height, depth; centre of the lower side.
        albedo: at 860 nm, relative to a white wall.
        edge_mm: radius of the edges.
        cells: number of cells along each side, odd; 3 bevels an edge in two steps.
        plump_mm: height of the bulge of each side, for cushions (cells >= 5).
        region: name in the layer "regions".
    """
    half = np.asarray(size_mm, np.float64) / 2
    radius = min(edge_mm, 0.98 * float(half.min()))
    directions, faces = _cube(cells if radius > 0 else 1)
    points = np.sign(directions) * half
    if radius > 0:
        round_part = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        points = np.sign(directions) * (half - radius) + radius * round_part
    if plump_mm:
        side = np.abs(directions) > 0.99
        bulge = np.prod(np.where(side, 1.0, np.cos(directions * np.pi / 2)), axis=1)
        bulge[side.sum(axis=1) > 1] = 0.0  # no bulge at the edges
        points = points + np.where(side, np.sign(directions), 0) * plump_mm * bulge[:, None]
    points = points + np.asarray(at_mm, np.float64) + (0, half[1], 0)
    return Shape(points, faces, albedo, region)


@lru_cache(maxsize=8)
def _cube(cells: int) -> tuple[Points, Triangles]:
    """Return vertices and faces of the cube [-1, 1]^3 with ``cells`` x ``cells`` quads per side."""
    steps = np.linspace(-1, 1, cells + 1)
    u, v = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    sides = [
        np.roll(np.stack([np.full(len(u), sign), u, sign * v], axis=1), axis, axis=1)
        for axis in range(3)
        for sign in (1.0, -1.0)
    ]
    faces = np.concatenate([grid_triangles(cells + 1, cells + 1) + n * len(u) for n in range(6)])
    unique, index = np.unique(np.round(np.concatenate(sides), 9), axis=0, return_inverse=True)
    return unique, index.reshape(-1)[faces].astype(np.int32)


def turned_body(profile_mm: ArrayLike, albedo: float = 0.8, *, segments: int = 12) -> Shape:
    """Revolve a profile, (radius, height) from bottom to top, about y; radius 0 closes an end."""
    radius, height = np.asarray(profile_mm, np.float64).T
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    columns = np.outer(radius, np.sin(angle)), height[:, None], np.outer(radius, np.cos(angle))
    points = np.stack(np.broadcast_arrays(*columns), axis=-1).reshape(-1, 3)
    return Shape(points, _turned_faces(tuple(radius), segments), albedo)


@lru_cache(maxsize=64)
def _turned_faces(radius: tuple[float, ...], segments: int) -> Triangles:
    """Return the triangles of a body of revolution; a row of radius 0 is a single point."""
    index = np.arange(len(radius) * segments, dtype=np.int32).reshape(len(radius), segments)
    index[np.array(radius) == 0] = index[np.array(radius) == 0, :1]
    ring = np.concatenate([index, index[:, :1]], axis=1).ravel()
    return without_slivers(ring[grid_triangles(len(radius), segments + 1)[:, ::-1]])


def without_slivers(faces: Triangles) -> Triangles:
    """Return the triangles that have three different vertex indices."""
    a, b, c = faces.T
    return np.ascontiguousarray(faces[(a != b) & (b != c) & (c != a)], np.int32)


def rod(
    start_mm: ArrayLike, end_mm: ArrayLike, radius_mm: float, albedo: float = 0.8, *,
    end_radius_mm: float | None = None, sides: int = 8,
) -> Shape:  # fmt: skip
    """Make a closed rod between two points, of the same radius unless ``end_radius_mm`` differs."""
    start, end = np.asarray(start_mm, np.float64), np.asarray(end_mm, np.float64)
    length = norm(end - start)
    last = radius_mm if end_radius_mm is None else end_radius_mm
    profile = [(0, 0), (radius_mm, 0), (last, length), (0, length)]
    body = turned_body(profile, albedo, segments=sides)
    up = (end - start) / length
    side = np.cross(up, (0.0, 0.0, 1.0) if abs(up[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= norm(side)
    axes = np.stack([side, up, np.cross(side, up)])
    half_side = turned(body.vertices_mm, 180.0 / sides)
    return replace(body, vertices_mm=product(half_side, axes) + start)


def sheet(points_mm: Points, albedo: float = 0.8) -> Shape:
    """Make a sheet with a front and a back through points (rows, columns, 3), mm."""
    front = grid_triangles(*points_mm.shape[:2])
    return Shape(points_mm.reshape(-1, 3), np.concatenate([front, front[:, ::-1]]), albedo)


def plate(corners_mm: ArrayLike, albedo: float = 0.8, *, region: str = "furniture") -> Shape:
    """Make a flat convex polygon from corners (N, 3) mm, counter-clockwise seen from its front."""
    points = np.asarray(corners_mm, np.float64)
    fan = np.array([[0, n, n + 1] for n in range(1, len(points) - 1)], np.int32)
    return Shape(points, fan, albedo, region)


def tube(line: Reals, wide: float, deep: float, *, closed: bool) -> Shape:
    """Make a four-sided tube along a line, ``wide`` by ``deep`` mm."""
    count = len(line)
    around = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    along = around if closed else np.asarray(np.gradient(line, axis=0))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    first: Reals = np.cross(along, np.array([0.0, 0.0, 1.0]))
    level = np.linalg.norm(first, axis=1, keepdims=True) < 0.5  # lines along z, such as temples
    first = np.where(level, np.array([0.0, 1.0, 0.0]), first)
    first -= (first * along).sum(axis=1, keepdims=True) * along
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    corners = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    rings: Array = np.stack(
        [line + 0.5 * (u * wide * first + v * deep * second) for u, v in corners], axis=1
    )
    index = np.arange(count * 4).reshape(count, 4)
    after = np.roll(index, -1, axis=0) if closed else index[1:]
    here = index if closed else index[:-1]
    faces = []
    for k in range(4):
        p, q, r, s = here[:, k], here[:, (k + 1) % 4], after[:, (k + 1) % 4], after[:, k]
        faces += [np.stack([p, q, r], 1), np.stack([p, r, s], 1)]
    for quad in () if closed else (index[0, ::-1], index[-1]):
        faces += [quad[[0, 1, 2]][None], quad[[0, 2, 3]][None]]
    return Shape(rings.reshape(-1, 3), np.concatenate(faces))
