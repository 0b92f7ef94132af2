"""Lids that move on the globe: which vertices belong to them, and how they close.

Closing slides a lid over the globe. It is written as a quadratic in the closure a in [0, 1]:
displacement = a * linear + a^2 * square, exact at a = 0, 1/2 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.eyes import LID_REACH_ROWS, LID_THICKNESS
from glsim.faces.procedural.grid import EYE_KNOT, knot_row
from glsim.faces.procedural.sculpt import Array, bump
from glsim.faces.procedural.template import PART_EYEBALL, PART_SKIN, Template
from glsim.faces.procedural.topology import EYE_COLUMNS, SLIT_EYE
from glsim.faces.procedural.volumes import EYE_RADIUS

MEETING = 0.18  # where the closed lids meet: this share of the opening above the lower margin
OVERLAP_MM = 0.25  # the upper lid ends this far below the lower one's edge when shut
LID_ROWS = 13  # rows above or below the slit that a lid can move


@dataclass(frozen=True, eq=False)
class Lids:
    """The lid vertices of both eyes.

    index: (L,) vertices. upper, lower: (L,) how much each moves with the upper or lower margin.
    top, bottom: (L,) the margin vertices of its column. share: (L,) position between the corners,
    0 medial, 1 lateral. left: (L,) on the subject's left. globes: (V,) +1/-1 left/right eyeball.
    """

    index: NDArray[np.intp]
    upper: Array
    lower: Array
    top: NDArray[np.intp]
    bottom: NDArray[np.intp]
    share: Array
    left: NDArray[np.bool_]
    globes: NDArray[np.int8]


def make_lids(template: Template) -> Lids:
    """The lid vertices of the template."""
    row, column = knot_row(EYE_KNOT), np.abs(template.column)
    below = template.row - row
    first, last = EYE_COLUMNS
    grid = (template.part == PART_SKIN) & (np.abs(below) <= LID_ROWS) & (template.ring == 0)
    lining = (template.slit == SLIT_EYE) & (template.ring > 0)
    index = np.flatnonzero((grid | lining) & (column > first) & (column < last))
    on_slit = template.slit[index] == SLIT_EYE
    is_low = np.where(on_slit, template.low[index], below[index] > 0)
    weight = np.where(on_slit, 1.0, bump(below[index].astype(np.float64), LID_REACH_ROWS))
    margin = {
        (int(template.column[i]), bool(template.low[i])): int(i)
        for i in np.flatnonzero((template.slit == SLIT_EYE) & (template.ring == 0))
    }
    signed = template.column[index]
    globe = (template.part == PART_EYEBALL) * np.where(template.points[:, 0] > 0, 1, -1)
    return Lids(
        index=index,
        upper=np.where(is_low, 0.0, weight),
        lower=np.where(is_low, weight, 0.0),
        top=np.array([margin[int(c), False] for c in signed]),
        bottom=np.array([margin[int(c), True] for c in signed]),
        share=(column[index] - first) / (last - first),
        left=signed > 0,
        globes=globe.astype(np.int8),
    )


def globe_relief(points: Array, centers: Array, radius: float) -> Array:
    """Height z (N,) of the globe of ``radius`` under points (N, 3); flattens out beyond its rim."""
    away = np.sum(np.square(points[:, :2] - centers[:, :2]), axis=1)
    return np.asarray(centers[:, 2] + np.sqrt(np.maximum(radius**2 - away, (0.35 * radius) ** 2)))


def closing(points: Array, centers: Array, lids: Lids) -> tuple[Array, Array, Array, Array]:
    """How a subject's lids close: (upper linear, upper square, lower linear, lower square).

    points: (V, 3) the subject's neutral head; centers: (2, 3) its left and right globe centres.
    Each result is (L, 3) mm for the lid vertices.
    """
    own = points[lids.index]
    center = np.where(lids.left[:, None], centers[0], centers[1])
    gap = points[lids.top, 1] - points[lids.bottom, 1]
    fall = np.maximum(gap * (1.0 - MEETING) + OVERLAP_MM, 0.0) * lids.upper
    rise = np.maximum(gap * MEETING, 0.0) * lids.lower
    results = []
    for drop in (fall, -rise):
        half, full = (_slid(own, center, amount * drop) for amount in (0.5, 1.0))
        results += [4.0 * half - full, 2.0 * full - 4.0 * half]
    return results[0], results[1], results[2], results[3]


def _slid(points: Array, centers: Array, drop: Array) -> Array:
    """Displacement (L, 3) of points lowered by ``drop`` (L,) while they ride on the globe."""
    moved = points.copy()
    moved[:, 1] -= drop
    radius = EYE_RADIUS + LID_THICKNESS
    moved[:, 2] += globe_relief(moved, centers, radius) - globe_relief(points, centers, radius)
    return moved - points
