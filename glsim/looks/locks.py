"""Sheets of strands that hang from the head, and tied bundles of hair."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from glsim.core.array_types import Floats, Reals, Triangles, Whole
from glsim.core.products import norm, product, units
from glsim.looks.anatomy import Anatomy
from glsim.looks.noise import smooth_noise
from glsim.looks.skin_grid import grid_triangles
from glsim.looks.styles import CROWN, HALO_MM, STYLE_TABLE, HairStyle

#: Number of directions in which the radius of a head is measured, evenly spread (a golden spiral),
#: and sharpness of the weights between them. Chosen: neighbours are 0.14 rad apart.
_DIRECTIONS, _SHARPNESS = 642, 160.0
#: Largest displacement of a point out of the skin by one call, mm. The value was chosen.
_PUSH_MM = 12.0
#: Sine of the elevation of the jaw seen from the centre of the skull. The value was chosen.
_JAW = -0.6
#: Number of columns of a sheet around the head, and distance of its rows, mm. Chosen.
_COLUMNS, _ROW_MM = 48, 14.0
#: Sine of the elevation above the centre of the skull at which a sheet begins. Chosen.
_START = 0.18
#: Depth of each hanging sheet below the outermost, mm, and the share of it that strands cover.
_HANGING: Final = ((-HALO_MM, 1.0), (0.0, 0.45), (5.0, 0.75), (10.0, 0.95))
#: Length of a strand that is seen before another one lies over it, in widths of a strand. Chosen.
_LONG = 12.0
#: Depth below the top of the hair at which 1 / e of the light is left, mm: lib/strands.glsl.
LOST_MM = 11.0
_DOWN: Final = np.array([0.0, -1.0, 0.0])


class Sheet(NamedTuple):
    """A sheet of hair of N vertices; ``strands`` are as in ``Mesh``.

    ``roots``: (N,) scalp point of each vertex; ``light``: (N,) share of the light that reaches it.
    """

    roots: Whole
    points_mm: Reals
    faces: Whole | Triangles
    strands: Reals
    light: Reals


def spiral(count: int) -> Reals:
    """Return unit vectors (count, 3) that are spread evenly over all directions."""
    height, number = (np.arange(count) + 0.5) / count, np.arange(count)
    turn, level = np.pi * (1 + 5**0.5) * number, np.sqrt(height * (1 - height))
    return np.stack([2 * level * np.cos(turn), 1 - 2 * height, 2 * level * np.sin(turn)], axis=1)


def hull_mm(points: Reals, ways: Reals) -> Reals:
    """Return the distance (...) to the convex hull of points (N, 3) in directions (..., 3)."""
    normals = spiral(1200)  # 0.1 rad apart: chosen
    cosine = product(ways.reshape(-1, 3), normals.T)
    support = product(normals, points.T).max(axis=1, initial=0.0)
    reach = np.where(cosine > 0.3, support / np.maximum(cosine, 0.3), np.inf).min(axis=1)
    return np.asarray(reach.reshape(ways.shape[:-1]))


class Obstacle:
    """The surface of head and neck, as radii in directions from the centre of the skull."""

    def __init__(self, anatomy: Anatomy, skin_mm: Reals) -> None:
        """Measure the radii from the subject's resting vertices (V, 3), mm."""
        self.centre = anatomy.centre
        self._units = spiral(_DIRECTIONS).astype(np.float32)
        # Use every sixth vertex: these are still about four per direction.
        out = skin_mm[anatomy.outside & ~anatomy.body][::6] - self.centre
        length = np.linalg.norm(out, axis=1)
        cell = np.argmax(product((out / length[:, None]).astype(np.float32), self._units.T), axis=1)
        radius = np.full(len(self._units), -1.0)
        np.maximum.at(radius, cell, length)
        filled = radius > 0
        near = np.argmax(product(self._units, self._units[filled].T), axis=1)
        self._radius = np.where(filled, radius, radius[filled][near]).astype(np.float32)

    def radius(self, units: Floats) -> Floats:
        """Return the radii, (N,) mm, in directions (N, 3)."""
        weight = np.exp(np.float32(_SHARPNESS) * (product(units, self._units.T) - 1))
        return np.asarray((weight * self._radius).sum(axis=1) / weight.sum(axis=1))

    def push_out(self, points: Reals, least_mm: float) -> Reals:
        """Move points, (N, 3) mm, radially out of the head to at least the height ``least_mm``."""
        out = points - self.centre
        length = np.linalg.norm(out, axis=1)
        unit = (out / length[:, None]).astype(np.float32)
        # Below the jaw the neck is narrower than the head, and shoulders are not in the way.
        out_mm = np.where(unit[:, 1] > _JAW, self.radius(unit) + least_mm, 0.0)
        length = np.clip(out_mm, length, length + _PUSH_MM)
        return np.asarray(self.centre + unit * length[:, None])

    def along(self, points: Reals, way_mm: Reals) -> Reals:
        """Move points, (N, 3) mm, along the surface by (N, 3) mm; their heights stay."""
        first, second = points - self.centre, points + way_mm - self.centre
        old, new = units(first).astype(np.float32), units(second).astype(np.float32)
        change = np.clip(self.radius(new) - self.radius(old), -_PUSH_MM, _PUSH_MM)
        length = np.linalg.norm(first, axis=1) + change
        return np.asarray(self.centre + new * length[:, None])


class Head(NamedTuple):
    """A subject's head, hair style and scalp points ``base`` (N, 3), from which hair grows, mm.

    Args:
        obstacle: surface that hair must not enter.
        directions: (N, 3) unit vectors from the centre of the skull to the scalp's points.
        thickness, ragged: (N,) mm, of the hair; and inside its ragged edge, negative outside.
        seed: of the relief.
    """

    anatomy: Anatomy
    obstacle: Obstacle
    style: HairStyle
    rng: np.random.Generator
    directions: Floats
    base: Reals
    thickness: Reals
    ragged: Reals
    seed: int


def strands_of(style: HairStyle, places: Reals, cover: Reals, sink: Reals, seed: int) -> Reals:
    """Return the strands, (N, 5) as in ``Mesh``, at (N, 3) mm across and along the strands."""
    long = 1.0 if style.comb == "curls" else _LONG
    cells = places / (style.strand * np.array([1.0, 1.0, long])) + seed % 997
    return np.column_stack([cells, cover, sink])


def combed(head: Head, points: Reals) -> Reals:
    """Compute the directions of strands at points (N, 3): unit vectors along the skull."""
    comb = head.style.comb
    centre = head.anatomy.centre
    out = units(points - centre)
    if comb == "curls":
        return units(out - (0.0, 0.3, 0.0))
    wanted = np.zeros_like(out)
    if comb == "crown":
        wanted[:] = out - CROWN
    elif comb == "back":
        wanted[:] = (0.0, -0.25, -1.0)
    else:
        parting = head.style.parting * head.anatomy.scale
        side = np.tanh((points[:, 0] - centre[0] - parting * np.clip(out[:, 1], 0, 1)) / 6.0)
        wanted[:, 0] = side * np.clip(out[:, 1] + 0.2, 0, 1)
        wanted[:, 1] = -np.clip(1.0 - out[:, 1], 0.15, 1)
        wanted[:, 2] = -0.25 * np.clip(out[:, 1], 0, 1) - 0.6 * np.clip(out[:, 2], 0, 1)
    wanted -= (wanted * out).sum(axis=1, keepdims=True) * out
    return np.asarray(wanted / np.maximum(np.linalg.norm(wanted, axis=1, keepdims=True), 0.05))


def hanging(head: Head) -> list[Sheet]:
    """Make the sheets that hang from the left temple around the back to the right temple."""
    style, rng, scale = head.style, head.rng, head.anatomy.scale
    if not style.hang:
        return []
    # Angles are measured from straight ahead; the face stays free.
    front = np.radians(style.open_deg)
    angle = np.linspace(front, 2 * np.pi - front, _COLUMNS)
    around = np.stack([np.sin(angle), np.zeros(_COLUMNS), np.cos(angle)], 1)
    rays = around * np.sqrt(1 - _START**2) + (0.0, _START, 0.0)
    root = np.argmax(product(rays.astype(np.float32), head.directions.T), axis=1)
    fall = style.hang * scale * rng.uniform(0.85, 1.15)
    rows = int(np.ceil(fall * 1.1 / _ROW_MM)) + 1
    points = head.base[root] + rays * (0.75 * head.thickness[root])[:, None]
    lines = [points]
    for row in range(1, rows):
        step = _DOWN + around * style.flare * (1 - 1.6 * (row / rows))
        points = head.obstacle.push_out(points + step * _ROW_MM, 0.45 * style.side * scale)
        lines.append(points)
    sheet = _smoothed(np.stack(lines))  # (rows, columns, 3)
    arc, down = angle * 85.0 * scale, np.arange(rows) * _ROW_MM
    where = np.stack(np.broadcast_arrays(arc[None, :], 0.0, down[:, None]), axis=2).reshape(-1, 3)
    # Strands swing in waves together, and lie in locks.
    slow = smooth_noise(where * (0.02, 1, 0.012), head.seed + 5)
    swing = np.sin(2 * np.pi * where[:, 2] / (52 * scale) + 2.5 * slow)
    locks = smooth_noise(where * (1 / 13, 1, 1 / 100), head.seed + 6)
    grown = np.minimum(where[:, 2] / 30.0, 1.0)
    height = 1.1 * style.relief * locks + grown * (0.5 * style.wave * swing + 3.0 * slow)
    # Fewer strands reach the tips, some are cut shorter, and at the face the sheet is thin.
    left = fall * (1 + 0.2 * locks) - where[:, 2]
    rim = np.minimum(np.arange(_COLUMNS), np.arange(_COLUMNS)[::-1])
    dense = style.density * np.clip(left / (0.35 * fall), 0, 1)
    dense = dense * np.tile(np.clip((rim + 1) / 4, 0, 1), rows)
    faces = grid_triangles(rows, _COLUMNS)
    sheets = []
    for deep, cover in _HANGING:
        raised = sheet + (height.reshape(rows, -1, 1) - deep) * (around + np.array([0.0, 0.1, 0.0]))
        cover, sink = (cover, 5.0) if deep >= 0 else (style.stray, deep)
        strands = strands_of(style, where, cover * dense, np.full(len(where), sink), head.seed)
        light = np.full(len(where), np.exp(-max(deep, 0.0) / LOST_MM))
        sheets.append(Sheet(np.tile(root, rows), raised.reshape(-1, 3), faces, strands, light))
    return sheets


def _smoothed(sheet: Reals) -> Reals:
    """Smooth a sheet (rows, columns, 3) over neighbours, except its first row."""
    for _ in range(4):
        wide = np.concatenate([sheet[:, :1], sheet, sheet[:, -1:]], axis=1)
        sheet = 0.25 * wide[:, :-2] + 0.5 * sheet + 0.25 * wide[:, 2:]
        middle = 0.25 * sheet[:-2] + 0.5 * sheet[1:-1] + 0.25 * sheet[2:]
        sheet = np.concatenate([sheet[:1], middle, sheet[-1:]])
    return sheet


def tied(head: Head) -> list[Sheet]:
    """Make the buns or tails of a style; each grows from one point of the scalp."""
    anatomy, scale, bundles = head.anatomy, head.anatomy.scale, []
    for point in STYLE_TABLE["ties"].get(head.style.extra, ()):
        tie = anatomy.eye + np.array(point) * scale
        root = int(np.argmin(np.linalg.norm(head.base - tie, axis=1)))
        out = head.base[root] - anatomy.centre
        out /= norm(out)
        make = _bun if "bun" in head.style.extra else _tail
        lines, width = make(head.base[root] + 6.0 * scale * out, out, scale, head.rng)
        bundles.append(_ribbons(head, lines, width, root))
    return bundles


def _ribbons(head: Head, lines: Reals, width: Reals, root: int) -> Sheet:
    """Make ribbons of strands along lines (rings, N, 3) mm, of (N,) mm width, from one root."""
    rings, count = lines.shape[:2]
    along = units(np.gradient(lines, axis=0))
    across = units(np.cross(along, units((lines - head.anatomy.centre) * (1.0, 0.5, 1.0))))
    side = np.array([-0.5, 0.0, 0.5])
    half = width[None, :, None] * side
    points = lines[:, :, None] + half[..., None] * across[:, :, None]
    raised = 0.13 * (width[None, :, None] * (1 - 2 * np.abs(side)))[..., None]
    points += raised * np.cross(across, along)[:, :, None]
    lock = np.arange(count)[None, :, None]
    down = np.cumsum(np.append(0.0, np.linalg.norm(np.diff(lines, axis=0), axis=2).mean(axis=1)))
    where = np.stack(np.broadcast_arrays(half, 40.0 * lock, down[:, None, None]), -1).reshape(-1, 3)
    dense = np.clip(4.0 * (1.05 - np.linspace(0, 1, rings)), 0, 1)[:, None, None]
    cover = np.broadcast_to(dense * (1 - np.abs(side)), (rings, count, 3)).ravel()
    # Locks shade each other: a third of a bundle's thickness, chosen.
    strands = strands_of(head.style, where, cover, np.full(len(where), 9.0), head.seed)
    faces = np.concatenate([grid_triangles(rings, 3) + 3 * rings * k for k in range(count)])
    order = np.arange(rings * count * 3).reshape(rings, count, 3).transpose(1, 0, 2).ravel()
    roots = np.full(len(where), root)
    return Sheet(roots, points.reshape(-1, 3)[order], faces, strands[order], np.ones(len(where)))


def _bun(tie: Reals, out: Reals, scale: float, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Compute centre lines (10, 26, 3) and widths (26,), mm, of locks wound around a ball."""
    radius = rng.uniform(24, 34) * scale
    axis = units(rng.normal(0, 1, (26, 3)) + 2.0 * out)
    first = units(np.cross(axis, rng.normal(0, 1, (26, 3))))
    second = np.cross(axis, first)
    turn = np.linspace(0, 1.6 * np.pi, 10)[:, None, None]
    high = rng.uniform(-0.9, 0.9, 26)[None, :, None]
    ring = np.sqrt(1 - high**2) * (np.cos(turn) * first + np.sin(turn) * second) + high * axis
    lines = tie + 0.75 * radius * out + radius * rng.uniform(0.88, 1.06, (1, 26, 1)) * ring
    return lines, np.full(26, 17.0 * scale)


def _tail(tie: Reals, out: Reals, scale: float, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Compute centre lines (16, 70, 3) and widths (70,), mm, of locks that hang from a tie."""
    length = rng.uniform(150, 290) * scale * rng.uniform(0.55, 1.0, 70)
    share = np.linspace(0, 1, 16)[:, None, None]
    spread = np.clip(rng.normal(0, 1, (1, 70, 3)), -1.7, 1.7) * np.array([10.0, 4.0, 9.0]) * scale
    arc = out * (34 * scale) * np.sin(np.clip(2.2 * share, 0, 1) * np.pi / 2)
    drop = _DOWN * length[None, :, None] * np.clip(share - 0.08, 0, 1)
    # A tail is widest below the tie and narrows to its tip; its locks swing and cross each other.
    wide = 0.25 + 2.1 * np.sqrt(share) * (1 - 0.72 * share)
    phase = rng.uniform(0, 2 * np.pi, (1, 70, 3))
    swing = 2.8 * scale * np.sqrt(share) * np.sin(2 * np.pi * (1.3 * share) + phase)
    return tie + arc + drop + spread * wide + swing, rng.uniform(6, 11, 70) * scale
