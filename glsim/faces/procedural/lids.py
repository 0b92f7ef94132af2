"""Lids that slide on the eyeball: their vertices and their closing motion.

The skin of a closing lid moves along the neutral surface, and beyond the margin of the open lid
along the eyeball. The motion is a quadratic in the closure a in [0, 1], displacement =
a * linear + a^2 * square, exact at a = 0, 1/2 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.eyes import LID_REACH_ROWS, LID_THICKNESS
from glsim.faces.procedural.falloff import Array, bump
from glsim.faces.procedural.grid import EYE_KNOT, knot_row
from glsim.faces.procedural.template import PART_SKIN, Template
from glsim.faces.procedural.topology import EYE_COLUMNS, SLIT_EYE
from glsim.faces.procedural.volumes import EYE_RADIUS

CLOSED_LINE = 0.18  # closed lids meet at this share of the opening above the lower margin
OVERLAP_MM = 0.25  # distance of the closed upper lid's edge below the lower lid's edge
LID_ROWS = 11  # rows above or below the slit that a lid can move


@dataclass(frozen=True, eq=False)
class Lids:
    """The lid vertices of both eyes.

    Args:
        index: (L,) vertices.
        upper, lower: (L,) weights of the motion of the upper and lower margin.
        share: (L,) position between the corners, 0 medial, 1 lateral.
        left: (L,) on the subject's left.
        strips: upper and lower, each (C, LID_ROWS) vertices of the C columns, margin first.
        strip_left: (C,) whether a column belongs to the left eye.
        linings: upper and lower, each (P,) strip numbers and (P,) vertices of the rings behind the
            margin.
    """

    index: NDArray[np.intp]
    upper: Array
    lower: Array
    share: Array
    left: NDArray[np.bool_]
    strips: tuple[NDArray[np.intp], NDArray[np.intp]]
    strip_left: NDArray[np.bool_]
    linings: tuple[
        tuple[NDArray[np.intp], NDArray[np.intp]], tuple[NDArray[np.intp], NDArray[np.intp]]
    ]


def make_lids(template: Template) -> Lids:
    """Find the lid vertices of the template."""
    row, (first, last) = knot_row(EYE_KNOT), EYE_COLUMNS
    column, on_slit = np.abs(template.column), template.slit == SLIT_EYE
    below = template.row - row
    grid = (template.part == PART_SKIN) & (template.ring == 0)
    inside = (column > first) & (column < last)
    is_low = np.where(on_slit, template.low, below > 0)
    near = inside & ((grid & (np.abs(below) < LID_ROWS)) | (on_slit & (template.ring > 0)))
    index = np.flatnonzero(near)
    weight = np.where(on_slit, 1.0, bump(below.astype(np.float64), LID_REACH_ROWS))[index]
    columns = [c * side for side in (1, -1) for c in range(first + 1, last)]
    strips, linings = [], []
    for low in (False, True):
        place = {
            (abs(int(below[i])), int(template.column[i])): int(i)
            for i in index
            if is_low[i] == low and template.ring[i] == 0
        }
        strips.append(np.array([[place[k, c] for k in range(LID_ROWS)] for c in columns]))
        behind = np.flatnonzero(near & (template.ring > 0) & (template.low == low))
        strip = np.array([columns.index(int(template.column[i])) for i in behind])
        linings.append((strip, behind))
    return Lids(
        index=index,
        upper=np.where(is_low[index], 0.0, weight),
        lower=np.where(is_low[index], weight, 0.0),
        share=(column[index] - first) / (last - first),
        left=template.column[index] > 0,
        strips=(strips[0], strips[1]),
        strip_left=np.array(columns) > 0,
        linings=(linings[0], linings[1]),
    )


def globe_height(x: Array, y: Array, centers: Array) -> Array:
    """Return the height z of the lids' sphere at (x, y), flat beyond its rim. Shapes broadcast."""
    radius = EYE_RADIUS + LID_THICKNESS
    away = np.square(x - centers[..., 0]) + np.square(y - centers[..., 1])
    return np.asarray(centers[..., 2] + np.sqrt(np.maximum(radius**2 - away, (0.3 * radius) ** 2)))


def lid_closure(points: Array, centers: Array, lids: Lids) -> tuple[Array, Array, Array, Array]:
    """Return a subject's closing motion: (upper linear, upper square, lower linear, lower square).

    Each result is (L, 3) mm for the lid vertices ``lids.index``.

    Args:
        points: (V, 3) mm, the neutral head.
        centers: (2, 3) mm, left and right eyeball centres.
    """
    upper, lower = lids.strips
    gap = np.maximum(points[upper[:, 0], 1] - points[lower[:, 0], 1], 0.0)
    globes = np.where(lids.strip_left[:, None], centers[0], centers[1])
    travels = (gap * (1.0 - CLOSED_LINE) + OVERLAP_MM, gap * CLOSED_LINE)
    results = []
    for number, travel in enumerate(travels):
        half, full = (_slide(points, lids, globes, number, a * travel) for a in (0.5, 1.0))
        results += [4.0 * half - full, 2.0 * full - 4.0 * half]
    return results[0], results[1], results[2], results[3]


def _slide(points: Array, lids: Lids, globes: Array, number: int, travel: Array) -> Array:
    """Return the displacement (L, 3) when the lid margins move by ``travel`` (C,) mm to close.

    number: 0 for the upper lids, 1 for the lower ones.
    """
    strip, (lining_strip, lining) = lids.strips[number], lids.linings[number]
    up = 1.0 if number == 0 else -1.0  # from the margin outwards
    x, y, z = points[strip, 0], up * points[strip, 1], points[strip, 2]
    moved = y - travel[:, None] * bump(np.arange(LID_ROWS, dtype=np.float64), LID_REACH_ROWS)
    on_skin = np.array([np.interp(m, a, b) for m, a, b in zip(moved, y, z, strict=True)])
    center = globes[:, None, :]
    edge = globe_height(x[:, :1], up * y[:, :1], center)
    on_globe = z[:, :1] + globe_height(x, up * moved, center) - edge
    height = np.where(moved < y[:, :1], on_globe, on_skin)
    change = np.zeros_like(points)
    change[strip, 1] = up * (moved - y)
    change[strip, 2] = height - z
    change[lining] = change[strip[lining_strip, 0]]
    return np.asarray(change[lids.index])
