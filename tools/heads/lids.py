"""Find the vertices of the lids on the template, and their weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.lids import LID_REACH_ROWS, LID_ROWS, Lids
from tools.heads.falloff import Array, bump
from tools.heads.grid import EYE_KNOT, knot_row
from tools.heads.template import PART_SKIN, Template
from tools.heads.topology import EYE_COLUMNS, SLIT_EYE


@dataclass(frozen=True, eq=False)
class LidWeights:
    """The lid vertices of both eyes with their places, for fields that move them.

    Args:
        index: (L,) vertices.
        upper, lower: (L,) weights of the motion of the upper and lower margin.
        share: (L,) position between the corners, 0 medial, 1 lateral.
        left: (L,) on the subject's left.
    """

    index: NDArray[np.intp]
    upper: Array
    lower: Array
    share: Array
    left: NDArray[np.bool_]


def make_lids(template: Template) -> tuple[LidWeights, Lids]:
    """Find the lid vertices of the template, and the columns in which they close."""
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
        linings.append(np.stack([strip, behind], axis=1))
    left = template.column[index] > 0
    weights = LidWeights(
        index=index,
        upper=np.where(is_low[index], 0.0, weight),
        lower=np.where(is_low[index], weight, 0.0),
        share=(column[index] - first) / (last - first),
        left=left,
    )
    columns_left = np.array(columns) > 0
    return weights, Lids(index, left, np.array(strips), columns_left, np.array(linings))
