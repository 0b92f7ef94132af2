"""Grow locks of hair over a head: ribbons with a ridge, off the skin, pulled by gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core.products import product
from glsim.looks.anatomy import Anatomy, Array
from glsim.looks.comb import Comb
from glsim.looks.noise import smooth_noise
from glsim.looks.styles import HairStyle

#: Directions of even density (a golden spiral) in which the radius of a head is known, and the
#: sharpness of the weights by which it is read off them; chosen: neighbours are 0.14 rad apart.
_DIRECTIONS = 642
_SHARPNESS = 160.0
#: Largest move out of the skin at once, mm; chosen.
_PUSH_MM = 12.0
#: A lock has a ring of vertices every so many mm, at least 5 and at most 14 rings.
#: Distance of the relief within a lock, mm; chosen: strands part every few millimetres.
_STRAND_MM = 6.0
_STEP_MM, _RINGS = 18.0, (5, 14)


@dataclass(frozen=True, eq=False)
class Locks:
    """Meshes of locks.

    Args:
        roots: (N,) index of the scalp's point that carries a vertex.
        points_mm: (N, 3).
    """

    roots: NDArray[np.int64]
    points_mm: Array
    faces: NDArray[np.int64]


class Obstacle:
    """The head and neck as a radius over directions from the middle of the skull."""

    def __init__(self, anatomy: Anatomy, skin_mm: Array) -> None:
        """skin_mm: (V, 3) the subject's reference head."""
        self.centre = anatomy.centre
        place = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
        turn, level = np.pi * (1 + 5**0.5) * np.arange(_DIRECTIONS), np.sqrt(place * (1 - place))
        spiral = 2 * level * np.cos(turn), 1 - 2 * place, 2 * level * np.sin(turn)
        self._units = np.stack(spiral, axis=1).astype(np.float32)
        # Every third vertex: still about eight per direction.
        out = skin_mm[anatomy.outside & ~anatomy.body][::3] - self.centre
        length = np.linalg.norm(out, axis=1)
        cell = np.argmax(product((out / length[:, None]).astype(np.float32), self._units.T), axis=1)
        radius = np.full(len(self._units), -1.0)
        np.maximum.at(radius, cell, length)
        filled = radius > 0
        near = np.argmax(product(self._units, self._units[filled].T), axis=1)
        self._radius = np.where(filled, radius, radius[filled][near]).astype(np.float32)

    def push_out(self, points: Array, least_mm: Array, most_mm: Array | None = None) -> Array:
        """Return (N, 3) points moved along the ray from the middle of the skull.

        They end at least ``least_mm`` over the skin. Above the level of the ears, where hair lies
        on the head, they also end at most ``most_mm`` over it.
        """
        out = points - self.centre
        length = np.linalg.norm(out, axis=1)
        unit = (out / length[:, None]).astype(np.float32)
        weight = np.exp(np.float32(_SHARPNESS) * (product(unit, self._units.T) - 1))
        radius = (weight * self._radius).sum(axis=1) / weight.sum(axis=1)
        if most_mm is not None:
            lying = np.clip(2.0 + 5.0 * unit[:, 1], 0, 1)
            length = length + lying * (np.minimum(length, radius + most_mm) - length)
        # A ray down the neck leaves the skin far away: never move by more than a step.
        length = np.clip(radius + least_mm, length, length + _PUSH_MM)
        return np.asarray(self.centre + unit * length[:, None])


def grow_locks(
    anatomy: Anatomy,
    base: Array,
    thickness: Array,
    ragged: Array,
    comb: Comb,
    obstacle: Obstacle,
    style: HairStyle,
    rng: np.random.Generator,
) -> Locks:
    """Grow the locks of a style.

    Args:
        base: (N, 3) the scalp's points.
        thickness: (N,) mm.
        ragged: (N,) mm inside the rim.
    """
    candidates = np.flatnonzero(ragged > 1.0)
    if style.locks == 0 or len(candidates) == 0:
        return Locks(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    scale = anatomy.scale
    # A third of the locks grow near the rim: they make it ragged.
    odds = np.where(ragged[candidates] < 14, 2.5, 1.0)
    root = rng.choice(candidates, style.locks, p=odds / odds.sum())
    length = rng.uniform(*style.lock, style.locks) * scale
    local = (base[root] - anatomy.eye) / scale
    brow = _over_forehead(local)
    if style.fringe:
        length = np.where(brow, style.fringe * scale * rng.uniform(0.8, 1.1, style.locks), length)
    else:  # hair over the forehead is combed away from it, or short
        length = np.where(brow & (style.comb in ("crown", "curls")), 0.5 * length, length)
    rings = int(np.clip(style.lock[1] / _STEP_MM, *_RINGS))
    path = _paths(anatomy, base, thickness, root, length, brow, comb, obstacle, style, rings, rng)
    width = style.width * scale * rng.uniform(0.55, 1.35, style.locks)
    long = style.lock[1] > 100
    return make_ribbons(path, width, root, anatomy.centre, closed=long, rough_mm=1.2 * style.relief)


def _over_forehead(local: Array) -> NDArray[np.bool_]:
    return np.asarray((local[:, 2] > -62) & (np.abs(local[:, 0]) < 52) & (local[:, 1] > 40))


def _paths(
    anatomy: Anatomy,
    base: Array,
    thickness: Array,
    root: NDArray[np.int64],
    length: Array,
    brow: NDArray[np.bool_],
    comb: Comb,
    obstacle: Obstacle,
    style: HairStyle,
    rings: int,
    rng: np.random.Generator,
) -> Array:
    """Return (rings, N, 3) the middle lines of locks from root to tip."""
    count = len(root)
    out = base[root] - obstacle.centre
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    height = thickness[root] * rng.uniform(0.3, 1.15, count)
    place: Array = base[root] + out * height[:, None]
    stray = rng.normal(0, 0.05 + 0.12 * style.lift, (count, 3))
    phase, pitch = rng.uniform(0, 2 * np.pi, count), rng.uniform(28, 48, count) * anatomy.scale
    wave = style.wave * anatomy.scale * rng.uniform(0.4, 1.3, count)
    fall: Array = np.where(brow & (style.fringe > 0), np.maximum(style.fall, 0.5), style.fall)
    path = [place]
    step = length / (rings - 1)
    down = np.array([0.0, -1.0, 0.0])
    for ring in range(1, rings):
        share = ring / (rings - 1)
        along = comb.directions(place)
        if style.fringe:
            along[brow] = (0.0, -0.2, 1.0)
        out = place - obstacle.centre
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        hang = fall * np.clip(1.3 * share + 0.25, 0, 1)
        heading = (1 - hang)[:, None] * along + hang[:, None] * down
        heading += style.lift * (1 - share) * out + stray
        heading /= np.linalg.norm(heading, axis=1, keepdims=True)
        place = place + heading * step[:, None]
        least = np.maximum(height * (1 - 0.5 * share), 2.0)
        place = obstacle.push_out(place, least, height + 3.0 + 16.0 * style.lift * share)
        path.append(place)
    lines = _off_the_face(anatomy, np.stack(path), style)
    travelled = np.linspace(0, 1, rings)[:, None] * length
    swing = wave * np.minimum(travelled / 25.0, 1.0)
    turn = 2 * np.pi * travelled / pitch + phase
    level = lines - obstacle.centre
    level[..., 1] *= 0.3
    level /= np.linalg.norm(level, axis=2, keepdims=True)
    across = np.cross(np.gradient(lines, axis=0), level)
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-6)
    lines = lines + (swing * np.sin(turn))[..., None] * across
    return np.asarray(lines + (0.6 * swing * (1 + np.cos(turn)))[..., None] * level)


def _off_the_face(anatomy: Anatomy, lines: Array, style: HairStyle) -> Array:
    """End (rings, N, 3) lines where they reach the face; a fringe ends over the eyes."""
    local = (lines - anatomy.eye) / anatomy.scale
    low = 16.0 if style.fringe else 50.0
    before = (np.abs(local[..., 0]) < 58) & (local[..., 2] > -48) & (local[..., 1] < low)
    ends = np.where(before.any(axis=0), np.argmax(before, axis=0) - 1, len(lines) - 1)
    ring = np.minimum(np.arange(len(lines))[:, None], np.maximum(ends, 0)[None, :])
    return np.asarray(np.take_along_axis(lines, ring[..., None], axis=0))


def make_ribbons(
    lines: Array,
    width: Array,
    root: NDArray[np.int64],
    centre: Array,
    *,
    closed: bool,
    rough_mm: float = 0.0,
) -> Locks:
    """Make ribbons with a ridge along (rings, N, 3) lines; closed ones can be seen from inside.

    Args:
        width: (N,) mm.
        root: (N,) index of the scalp's point that carries each lock.
        rough_mm: height of the relief of strands.
    """
    rings, count = lines.shape[:2]
    along = np.gradient(lines, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-6)
    out = lines - centre
    out[..., 1] *= 0.5
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    across = np.cross(along, out)
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-6)
    out = np.cross(across, along)
    share = np.linspace(0, 1, rings)
    taper = np.clip(1.6 * (1.04 - share), 0, 1) ** 0.8 * np.clip(0.5 + 3 * share, 0, 1)
    half = 0.5 * taper[:, None, None] * width[None, :, None]
    ridge = lines + 0.26 * half * out
    points = np.stack([lines - half * across, ridge, lines + half * across], axis=2)
    if rough_mm:
        # Strands of a lock part and cross: its surface is no smooth band.
        places = points.reshape(-1, 3) / _STRAND_MM
        rough = rough_mm * smooth_noise(places, len(places)).reshape(points.shape[:3])
        points += (rough * taper[:, None, None])[..., None] * out[:, :, None]
    index = np.arange(rings * count * 3).reshape(rings, count, 3)
    pairs = ((0, 1), (1, 2), (2, 0)) if closed else ((0, 1), (1, 2))
    faces = []
    for a, b in pairs:
        p, q, r, s = index[:-1, :, a], index[:-1, :, b], index[1:, :, b], index[1:, :, a]
        faces += [np.stack([p, q, r], axis=-1), np.stack([p, r, s], axis=-1)]
    triangles = np.concatenate([f.reshape(-1, 3) for f in faces])
    # Keep the winding in which the ridge faces outwards.
    flat = points.reshape(-1, 3)
    roots = np.broadcast_to(root[None, :, None], index.shape).reshape(-1)
    return Locks(roots, flat, triangles)
