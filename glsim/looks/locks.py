"""Locks of hair: ribbons that lie on the head, sheets that hang from it, and tied bundles."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from glsim.core.array_types import Floats, Mask, Reals, Whole
from glsim.core.products import norm, product
from glsim.looks.anatomy import Anatomy
from glsim.looks.noise import ridges, smooth_noise
from glsim.looks.styles import Comb, HairStyle

#: Number of directions in which the radius of a head is measured, evenly spread (a golden spiral),
#: and sharpness of the weights between them. Chosen: neighbours are 0.14 rad apart.
_DIRECTIONS, _SHARPNESS = 642, 160.0
#: Largest displacement of a point out of the skin by one call, mm. The value was chosen.
_PUSH_MM = 12.0
#: Wavelength of the relief within a lock, mm. Chosen: strands part every few millimetres.
_STRAND_MM = 6.0
#: Distance between the rings of vertices of a lock, mm; range of the number of rings. Chosen.
_STEP_MM, _RINGS = 18.0, (5, 14)
#: Number of columns of a sheet around the head, 6 mm apart, and distance of its rows, mm. Chosen:
#: two pixels of a Kinect V2 at 0.9 m.
_COLUMNS, _ROW_MM = 76, 10.0
#: Sine of the elevation above the centre of the skull at which a sheet begins. Chosen.
_START = 0.18
#: Distance between the ridges of a sheet, mm, and the factor that stretches ridges along strands.
_RIDGE_MM, _ALONG = 13.0, 0.13
_DOWN: Final = np.array([0.0, -1.0, 0.0])
#: Style -> points where hair is tied, relative to the eyes of a mean adult, mm. Chosen.
_TIES: Final = {
    "bun": ((0.0, 22.0, -198.0),),
    "top bun": ((0.0, 112.0, -120.0),),
    "pony tail": ((0.0, 45.0, -194.0),),
    "twin tails": ((74.0, 40.0, -125.0), (-74.0, 40.0, -125.0)),
}
#: Direction of the crown, up and back, from which short hair radiates.
CROWN: Final = np.array([0.0, 0.86, -0.51])


class Locks(NamedTuple):
    """A mesh of locks: (N, 3) vertices, (F, 3) triangles, and each vertex's root on the scalp."""

    roots: Whole
    points_mm: Reals
    faces: Whole


class Obstacle:
    """The surface of head and neck, as radii in directions from the centre of the skull."""

    def __init__(self, anatomy: Anatomy, skin_mm: Reals) -> None:
        """Measure the radii from the subject's resting vertices (V, 3), mm."""
        self.centre = anatomy.centre
        height = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
        turn, level = np.pi * (1 + 5**0.5) * np.arange(_DIRECTIONS), np.sqrt(height * (1 - height))
        spiral = 2 * level * np.cos(turn), 1 - 2 * height, 2 * level * np.sin(turn)
        self._units = np.stack(spiral, axis=1).astype(np.float32)
        # Use every sixth vertex: these are still about four per direction.
        out = skin_mm[anatomy.outside & ~anatomy.body][::6] - self.centre
        length = np.linalg.norm(out, axis=1)
        cell = np.argmax(product((out / length[:, None]).astype(np.float32), self._units.T), axis=1)
        radius = np.full(len(self._units), -1.0)
        np.maximum.at(radius, cell, length)
        filled = radius > 0
        near = np.argmax(product(self._units, self._units[filled].T), axis=1)
        self._radius = np.where(filled, radius, radius[filled][near]).astype(np.float32)

    def push_out(self, points: Reals, least_mm: Reals, most_mm: Reals | None = None) -> Reals:
        """Move points, (N, 3) mm, radially out of the head to at least the heights ``least_mm``.

        Above the ears, where hair lies on the head, ``most_mm`` is the largest height.
        """
        out = points - self.centre
        length = np.linalg.norm(out, axis=1)
        unit = (out / length[:, None]).astype(np.float32)
        weight = np.exp(np.float32(_SHARPNESS) * (product(unit, self._units.T) - 1))
        radius = (weight * self._radius).sum(axis=1) / weight.sum(axis=1)
        if most_mm is not None:
            lying = np.clip(2.0 + 5.0 * unit[:, 1], 0, 1)
            length = length + lying * (np.minimum(length, radius + most_mm) - length)
        # A ray down the neck leaves the skin far away: the length of a move is limited.
        length = np.clip(radius + least_mm, length, length + _PUSH_MM)
        return np.asarray(self.centre + unit * length[:, None])


class Head(NamedTuple):
    """A subject's head, hair style and scalp points, from which locks grow.

    Args:
        obstacle: surface that locks must not enter.
        directions: (N, 3) unit vectors from the centre of the skull to the scalp's points.
        base: (N, 3) mm, the scalp's points.
        thickness: (N,) mm, thickness of the hair.
        ragged: (N,) mm, distance inside the ragged edge of the hair; negative outside.
    """

    anatomy: Anatomy
    obstacle: Obstacle
    style: HairStyle
    rng: np.random.Generator
    directions: Floats
    base: Reals
    thickness: Reals
    ragged: Reals


def all_locks(head: Head) -> list[Locks]:
    """Make all locks of a head: lying, hanging and tied hair."""
    locks = [_lying(head)] if head.style.locks and (head.ragged > 1.0).any() else []
    if head.style.hang:
        locks.append(_hanging(head))
    return locks + _tied(head)


def _lying(head: Head) -> Locks:
    """Make the locks that lie on the head."""
    style, rng, scale = head.style, head.rng, head.anatomy.scale
    candidates = np.flatnonzero(head.ragged > 1.0)
    # A third of the locks grow near the edge of the hair and make it ragged.
    odds = np.where(head.ragged[candidates] < 14, 2.5, 1.0)
    root = rng.choice(candidates, style.locks, p=odds / odds.sum())
    length = rng.uniform(*style.lock, style.locks) * scale
    x, y, z = ((head.base[root] - head.anatomy.eye) / scale).T
    brow = (z > -62) & (np.abs(x) < 52) & (y > 40)
    if style.fringe:
        length = np.where(brow, style.fringe * scale * rng.uniform(0.8, 1.1, style.locks), length)
    else:  # over the forehead hair is combed back, or short
        length = np.where(brow & (style.comb in ("crown", "curls")), 0.5 * length, length)
    path = _paths(head, root, length, brow)
    width = style.width * scale * rng.uniform(0.55, 1.35, style.locks)
    centre, is_long = head.anatomy.centre, style.lock[1] > 100
    return _ribbons(path, width, root, centre, closed=is_long, rough_mm=1.2 * style.relief)


def _units(vectors: Reals) -> Reals:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _directions(head: Head, points: Reals) -> Reals:
    """Compute the directions of strands at points (N, 3): unit vectors along the skull."""
    comb: Comb = head.style.comb
    centre = head.anatomy.centre
    out = _units(points - centre)
    if comb == "curls":
        return _units(out - (0.0, 0.3, 0.0))
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


def _paths(head: Head, root: Whole, length: Reals, brow: Mask) -> Reals:
    """Compute the centre lines (rings, N, 3) mm of locks, from root to tip."""
    style, rng, scale, centre = head.style, head.rng, head.anatomy.scale, head.obstacle.centre
    rings, count = int(np.clip(style.lock[1] / _STEP_MM, *_RINGS)), len(root)
    height = head.thickness[root] * rng.uniform(0.3, 1.15, count)
    points: Reals = head.base[root] + _units(head.base[root] - centre) * height[:, None]
    stray = rng.normal(0, 0.05 + 0.12 * style.lift, (count, 3))
    phase, pitch = rng.uniform(0, 2 * np.pi, count), rng.uniform(28, 48, count) * scale
    wave = style.wave * scale * rng.uniform(0.4, 1.3, count)
    fall: Reals = np.where(brow & (style.fringe > 0), np.maximum(style.fall, 0.5), style.fall)
    path = [points]
    for ring in range(1, rings):
        share = ring / (rings - 1)
        along = _directions(head, points)
        if style.fringe:
            along[brow] = (0.0, -0.2, 1.0)
        hang = fall * np.clip(1.3 * share + 0.25, 0, 1)
        heading = (1 - hang)[:, None] * along + hang[:, None] * _DOWN
        heading += style.lift * (1 - share) * _units(points - centre) + stray
        points = points + _units(heading) * (length / (rings - 1))[:, None]
        least = np.maximum(height * (1 - 0.5 * share), 2.0)
        points = head.obstacle.push_out(points, least, height + 3.0 + 16.0 * style.lift * share)
        path.append(points)
    lines = _off_the_face(head, np.stack(path))
    travelled = np.linspace(0, 1, rings)[:, None] * length
    swing = wave * np.minimum(travelled / 25.0, 1.0)
    turn = 2 * np.pi * travelled / pitch + phase
    level = _units((lines - centre) * (1.0, 0.3, 1.0))
    across = np.cross(np.gradient(lines, axis=0), level)
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-6)
    lines = lines + (swing * np.sin(turn))[..., None] * across
    return np.asarray(lines + (0.6 * swing * (1 + np.cos(turn)))[..., None] * level)


def _off_the_face(head: Head, lines: Reals) -> Reals:
    """Shorten lines (rings, N, 3) that reach the face; fringes end above the eyes."""
    local = (lines - head.anatomy.eye) / head.anatomy.scale
    low = 16.0 if head.style.fringe else 50.0
    before = (np.abs(local[..., 0]) < 58) & (local[..., 2] > -48) & (local[..., 1] < low)
    ends = np.where(before.any(axis=0), np.argmax(before, axis=0) - 1, len(lines) - 1)
    ring = np.minimum(np.arange(len(lines))[:, None], np.maximum(ends, 0)[None, :])
    return np.asarray(np.take_along_axis(lines, ring[..., None], axis=0))


def _ribbons(
    lines: Reals, width: Reals, root: Whole, centre: Reals, *, closed: bool, rough_mm: float = 0.0
) -> Locks:
    """Make ribbons with a ridge along lines (rings, N, 3).

    Args:
        lines: (rings, N, 3) mm, centre lines.
        width: (N,) mm, width of each lock.
        root: (N,) index of the scalp's point from which each lock grows.
        centre: (3,) mm, centre of the skull.
        closed: whether the ribbons have back faces too.
        rough_mm: height of the relief of strands.
    """
    rings, count = lines.shape[:2]
    along = np.gradient(lines, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-6)
    across = np.cross(along, _units((lines - centre) * (1.0, 0.5, 1.0)))
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-6)
    out = np.cross(across, along)
    share = np.linspace(0, 1, rings)
    taper = np.clip(1.6 * (1.04 - share), 0, 1) ** 0.8 * np.clip(0.5 + 3 * share, 0, 1)
    half = 0.5 * taper[:, None, None] * width[None, :, None]
    ridge = lines + 0.26 * half * out
    points = np.stack([lines - half * across, ridge, lines + half * across], axis=2)
    if rough_mm:
        # The lock has relief across its width, because its strands part and cross.
        places = points.reshape(-1, 3) / _STRAND_MM
        rough = rough_mm * smooth_noise(places, len(places)).reshape(points.shape[:3])
        points += (rough * taper[:, None, None])[..., None] * out[:, :, None]
    index = np.arange(rings * count * 3).reshape(rings, count, 3)
    faces = []
    for a, b in ((0, 1), (1, 2), (2, 0))[: 3 if closed else 2]:
        p, q, r, s = index[:-1, :, a], index[:-1, :, b], index[1:, :, b], index[1:, :, a]
        faces += [np.stack([p, q, r], -1).reshape(-1, 3), np.stack([p, r, s], -1).reshape(-1, 3)]
    roots = np.broadcast_to(root[None, :, None], index.shape).reshape(-1)
    return Locks(roots, points.reshape(-1, 3), np.concatenate(faces))


def _hanging(head: Head) -> Locks:
    """Make a rough sheet of hair from the left temple around the back to the right temple."""
    style, rng, scale = head.style, head.rng, head.anatomy.scale
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
        points = points + step * _ROW_MM
        points = head.obstacle.push_out(points, np.full(_COLUMNS, 0.45 * style.side * scale))
        lines.append(points)
    sheet = _smoothed(np.stack(lines))  # (rows, columns, 3)
    arc, down, none = angle * 85.0 * scale, np.arange(rows) * _ROW_MM, np.zeros(_COLUMNS)
    where = np.stack(np.broadcast_arrays(arc[None, :], down[:, None], 0.0), axis=2)
    seed = int(rng.integers(1 << 31))

    stretch = np.array([1.0, 1.0 if style.comb == "curls" else _ALONG, 1.0])
    strands = (where * stretch).reshape(-1, 3)
    relief = 0.7 * ridges(strands / _RIDGE_MM, seed) + 0.4 * smooth_noise(strands / 7.0, seed + 1)
    slow = smooth_noise((where * (0.5, 0.3, 1)).reshape(-1, 3) / 25.0, seed + 2).reshape(rows, -1)
    swing = np.sin(2 * np.pi * down[:, None] / (52 * scale) + 2.5 * slow)
    grown = np.minimum(down / 30.0, 1.0)[:, None]
    height = style.relief * 1.1 * relief.reshape(rows, -1)
    height = height + grown * (0.5 * style.wave * swing + 3.0 * slow)
    sheet = sheet + height[..., None] * (around + np.array([0.0, 0.1, 0.0]))
    end = fall * (1 + 0.10 * smooth_noise(np.stack([arc / 16, none, none], 1), seed + 3))
    end += 12 * smooth_noise(np.stack([arc / 7, none, none], 1), seed + 4)
    sheet = _stretched(sheet, end / down[-1])
    # The sheet has gaps, with more of them towards the tips and at both edges beside the face.
    torn = smooth_noise((where * (1 / 9, 1 / 60, 1)).reshape(-1, 3), seed + 5).reshape(rows, -1)
    rim = np.minimum(np.arange(_COLUMNS), np.arange(_COLUMNS)[::-1])
    solid = torn < 1.15 - 0.75 * (down / fall)[:, None] ** 3
    solid &= torn < 0.1 + rim[None, :] * 0.35
    index = np.arange(rows * _COLUMNS).reshape(rows, _COLUMNS)
    whole = solid[:-1, :-1] & solid[:-1, 1:] & solid[1:, :-1] & solid[1:, 1:]
    p, q, r, s = (
        part[whole] for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    )
    outer = np.concatenate([np.stack([p, r, q], 1), np.stack([p, s, r], 1)])
    faces = np.concatenate([outer, outer[:, ::-1]])  # both sides are visible
    return Locks(np.broadcast_to(root, index.shape).reshape(-1), sheet.reshape(-1, 3), faces)


def _stretched(sheet: Reals, share: Reals) -> Reals:
    """Shorten each column of a sheet (rows, columns, 3) to ``share``, (columns,), of its length."""
    rows = len(sheet)
    at = np.arange(rows)[:, None] * np.minimum(share, 1.0)[None, :]
    low = np.minimum(at.astype(int), rows - 2)[..., None]
    lower = np.take_along_axis(sheet, low, axis=0)
    upper = np.take_along_axis(sheet, low + 1, axis=0)
    return np.asarray(lower + (at[..., None] - low) * (upper - lower))


def _smoothed(sheet: Reals) -> Reals:
    """Smooth a sheet (rows, columns, 3) over neighbours, except its first row."""
    for _ in range(4):
        wide = np.concatenate([sheet[:, :1], sheet, sheet[:, -1:]], axis=1)
        sheet = 0.25 * wide[:, :-2] + 0.5 * sheet + 0.25 * wide[:, 2:]
        middle = 0.25 * sheet[:-2] + 0.5 * sheet[1:-1] + 0.25 * sheet[2:]
        sheet = np.concatenate([sheet[:1], middle, sheet[-1:]])
    return sheet


def _tied(head: Head) -> list[Locks]:
    """Make the buns or tails of a style; each grows from one point of the scalp."""
    anatomy, scale, bundles = head.anatomy, head.anatomy.scale, []
    for point in _TIES.get(head.style.extra, ()):
        tie = anatomy.eye + np.array(point) * scale
        root = int(np.argmin(np.linalg.norm(head.base - tie, axis=1)))
        out = head.base[root] - anatomy.centre
        out /= norm(out)
        make = _bun if "bun" in head.style.extra else _tail
        lines, width = make(head.base[root] + 6.0 * scale * out, out, scale, head.rng)
        roots = np.full(lines.shape[1], root)
        bundles.append(_ribbons(lines, width, roots, anatomy.centre, closed=True))
    return bundles


def _bun(tie: Reals, out: Reals, scale: float, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Compute centre lines (10, 26, 3) and widths (26,), mm, of locks wound around a ball."""
    radius = rng.uniform(24, 34) * scale
    axis = _units(rng.normal(0, 1, (26, 3)) + 2.0 * out)
    first = _units(np.cross(axis, rng.normal(0, 1, (26, 3))))
    second = np.cross(axis, first)
    turn = np.linspace(0, 1.6 * np.pi, 10)[:, None, None]
    high = rng.uniform(-0.9, 0.9, 26)[None, :, None]
    ring = np.sqrt(1 - high**2) * (np.cos(turn) * first + np.sin(turn) * second) + high * axis
    lines = tie + 0.75 * radius * out + radius * rng.uniform(0.88, 1.06, (1, 26, 1)) * ring
    return lines, np.full(26, 17.0 * scale)


def _tail(tie: Reals, out: Reals, scale: float, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Compute centre lines (12, 34, 3) and widths (34,), mm, of locks that hang from a tie."""
    length = rng.uniform(150, 290) * scale * rng.uniform(0.7, 1.0, 34)
    share = np.linspace(0, 1, 12)[:, None, None]
    spread = rng.normal(0, 1, (1, 34, 3)) * np.array([11.0, 4.0, 9.0]) * scale
    arc = out * (34 * scale) * np.sin(np.clip(2.2 * share, 0, 1) * np.pi / 2)
    drop = _DOWN * length[None, :, None] * np.clip(share - 0.08, 0, 1)
    lines = tie + arc + drop + spread * (0.25 + 1.1 * np.sqrt(share))
    return lines, rng.uniform(9, 15, 34) * scale
