"""Cloth that hangs around a trunk or a limb: it spans hollows and falls from what stands out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array
from glsim.geometry.products import norm, product

#: Height of a row of the lattice around a tube, mm; about the edges of the people's meshes.
ROW_MM: Final = 12.0
#: Between places of the middle of a limb that bends, mm.
_STEP_MM: Final = 40.0
#: Slope of cloth at the root of a limb, mm per mm; chosen.
_ROOT_SLOPE: Final = 0.8


@dataclass(frozen=True, eq=False)
class Tube:
    """Points around an axis, in cylindrical coordinates.

    Args:
        index: (M,) of the points in their grid.
        angle: (M,) rad around the axis; 0 where the points look to the front.
        along: (M,) mm from the upper end of the axis down.
        radius: (M,) mm.
        out: (M, 3) unit vectors away from the axis.
        count: columns of the lattice around the axis.
    """

    index: NDArray[np.int64]
    angle: Array
    along: Array
    radius: Array
    out: Array
    count: int

    @property
    def length_mm(self) -> float:
        """Length of the axis."""
        return float(self.along.max())


def make_tube(
    index: NDArray[np.int64],
    points: Array,
    start: Array,
    end: Array,
    front: Array,
    count: int,
    *,
    bends: bool = False,
) -> Tube:
    """Return the tube of some points around the axis from ``start`` to ``end``.

    Args:
        index: (M,) of the points in their grid.
        points: (M, 3) mm.
        start, end: (3,) mm; ``along`` is 0 at the start, and reaches as far as the points do.
        front: (3,) a direction that is not that of the axis; its angle is 0.
        count: columns of the lattice.
        bends: whether the axis follows the middle of the points, as in a bent arm.
    """
    axis = (end - start) / norm(end - start)
    first = front - (front * axis).sum() * axis
    first /= norm(first)
    second = np.cross(first, axis)
    away = points - start
    along = product(away, axis)
    away = away - along[:, None] * axis
    if bends:
        away -= _middles(along, away)
    radius = np.maximum(np.linalg.norm(away, axis=1), 1.0)
    angle = np.arctan2(product(away, second), product(away, first))
    return Tube(index, angle, np.maximum(along, 0.0), radius, away / radius[:, None], count)


def _middles(along: Array, away: Array) -> Array:
    """Return (M, 3) the middle of the points around each point's place on the axis, smoothed.

    Args:
        along: (M,) mm.
        away: (M, 3) mm from the straight axis.
    """
    place = np.maximum(along / _STEP_MM, 0.0)
    rows = int(place.max()) + 1
    row = np.minimum(place.astype(np.int64), rows - 1)
    low, high = np.full((rows, 3), np.inf), np.full((rows, 3), -np.inf)
    np.minimum.at(low, row, away)
    np.maximum.at(high, row, away)
    filled = np.flatnonzero(np.isfinite(low[:, 0]))
    middle = 0.5 * (low[filled] + high[filled])
    line = np.stack([np.interp(np.arange(rows), filled, middle[:, k]) for k in range(3)], axis=1)
    for _ in range(2):
        wide = np.concatenate([line[:1], line, line[-1:]])
        line = 0.25 * wide[:-2] + 0.5 * line + 0.25 * wide[2:]
    at = place - 0.5
    return np.stack([np.interp(at, np.arange(rows), line[:, k]) for k in range(3)], axis=1)


def hang(tube: Tube, ease_mm: Array, slope: float, reach: int, root_mm: float = 0.0) -> Array:
    """Return (M,) mm from the axis to cloth at the points of a tube; see ``hanging_lattice``."""
    return _sampled(hanging_lattice(tube, ease_mm, slope, reach, root_mm), tube)


def hanging_lattice(
    tube: Tube, ease_mm: Array, slope: float, reach: int, root_mm: float = 0.0
) -> Array:
    """Return (rows, columns) mm from the axis to cloth, rows ROW_MM apart, columns from the front.

    Around the axis the cloth is stretched like a band over what stands out, so that it spans
    hollows. Down the axis it falls from there and comes back to the body with a slope.

    Args:
        ease_mm: (R,) room between skin and cloth, at even places from the upper end to the lower.
        slope: mm nearer to the axis per mm down; 0 falls straight, less than 0 widens.
        reach: columns over which cloth spans hollows to either side.
        root_mm: from the upper end, where a limb widens into the trunk: cloth follows it there.
    """
    skin = _lattice(tube)
    rows, count = skin.shape
    ease = np.interp(np.linspace(0, 1, rows), np.linspace(0, 1, len(ease_mm)), ease_mm)
    cloth = skin + ease[:, None]
    turn = 2 * np.cos(2 * np.pi / count)
    for _ in range(reach):
        left, right = np.roll(cloth, 1, axis=1), np.roll(cloth, -1, axis=1)
        # The chord between the two neighbours, where it crosses the ray between them.
        cloth = np.maximum(cloth, turn * left * right / (left + right))
    for row in range(1, rows):
        fall = slope if row * ROW_MM > root_mm else _ROOT_SLOPE
        cloth[row] = np.maximum(cloth[row], cloth[row - 1] - fall * ROW_MM)
    for _ in range(3):  # cloth does not bend sharply
        wide = np.concatenate([cloth[:1], cloth, cloth[-1:]])
        smooth = 0.25 * wide[:-2] + 0.5 * cloth + 0.25 * wide[2:]
        smooth = 0.25 * np.roll(smooth, 1, 1) + 0.5 * smooth + 0.25 * np.roll(smooth, -1, 1)
        cloth = np.maximum(smooth, skin + 0.6 * ease[:, None])
    return cloth


def _lattice(tube: Tube) -> Array:
    """Return (rows, columns) the largest radius in each cell; empty ones get their neighbours'."""
    rows, cell = cells_of(tube)
    cells = np.zeros(rows * tube.count)
    np.maximum.at(cells, cell, tube.radius)
    lattice = cells.reshape(rows, tube.count)
    filled = np.flatnonzero(lattice.any(axis=1))
    for number in filled:
        found = np.flatnonzero(lattice[number])
        lattice[number] = np.interp(
            np.arange(tube.count), found, lattice[number, found], period=tube.count
        )
    nearest = filled[np.abs(np.arange(rows)[:, None] - filled).argmin(axis=1)]
    return np.asarray(lattice[nearest])


def cells_of(tube: Tube) -> tuple[int, NDArray[np.int64]]:
    """Return the number of rows of a tube's lattice, and (M,) the cell of each point."""
    rows = int(tube.length_mm / ROW_MM) + 2
    row = np.minimum((tube.along / ROW_MM + 0.5).astype(np.int64), rows - 1)
    column = np.rint(tube.angle / (2 * np.pi) * tube.count).astype(np.int64) % tube.count
    return rows, row * tube.count + column


def _sampled(lattice: Array, tube: Tube) -> Array:
    """Return (M,) values of a lattice at the points, interpolated."""
    at = np.minimum(tube.along / ROW_MM, len(lattice) - 1.001)
    row = at.astype(np.int64)
    down = at - row
    turn = tube.angle / (2 * np.pi) * tube.count % tube.count
    column = turn.astype(np.int64) % tube.count
    aside, following = turn - np.floor(turn), (column + 1) % tube.count
    upper = (1 - aside) * lattice[row, column] + aside * lattice[row, following]
    lower = (1 - aside) * lattice[row + 1, column] + aside * lattice[row + 1, following]
    return np.asarray((1 - down) * upper + down * lower)
