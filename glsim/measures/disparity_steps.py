"""Disparity steps between two surfaces: gaps without depth, depths in between, border band.

A camera pair cannot match what one of its imagers does not see: beside a foreground a stripe of the
background as wide as the difference of the two disparities has no depth, and so has a band at one
border of the image, as wide as the disparity there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Array, Mask, Whole
from glsim.measures.pixel_runs import goes_on, successive_runs

#: Neighbours of one surface differ by at most so many px of disparity; chosen, eight times the
#: noise of a D400.
_SAME_PX = 1.0
#: A step: at least so many px, and this ratio of the disparities. Chosen: four times the tolerance.
_LEAST_STEP_PX, _LEAST_RATIO = 4.0, 1.15
#: Least width of both surfaces, and the pixels at their ends whose median is their disparity.
_LEAST_RUN_PX, _END_PX = 10, 5
#: Both surfaces vary within _LEAST_RUN_PX by at most this share of the step: no slope counts.
_MOST_SLOPE = 0.25
#: Widest gap, px; a wider one is an object without depth. Chosen: the shadow of a hand at 0.3 m.
_MOST_GAP_PX = 80
#: Width, px, on each side of a step in which pixels between the surfaces are counted.
_BESIDE_PX = 3
#: Between: farther than this share of the step from either surface.
_BETWEEN = 0.15
#: A step goes on in the rows above and below, at most so many px away.
_MOST_SLANT_PX = 2
#: Fewest steps of a side, and fewest rows of a border, of a figure; chosen.
LEAST_STEPS, LEAST_ROWS = 20, 20
#: Pixels at the border of a band whose median is the disparity there.
_BORDER_PX = 6


class Steps(NamedTuple):
    """Disparity steps along the rows of an image; (N,) arrays with an entry per row and side.

    Attributes:
        right: whether the gap is to the right of the foreground, else to its left.
        gap: pixels between the two surfaces.
        empty: those of them without disparity.
        step: difference of the disparities: the width of a shadow of the whole baseline, px.
        near: pixels with disparity within 3 px of the step.
        between: those of them that lie between the surfaces.
    """

    right: Mask
    gap: Whole
    empty: Whole
    step: Array
    near: Whole
    between: Whole


def find_steps(disparity: Array) -> Steps:
    """Find disparity steps along (H, W) rows, px, that continue in the rows above and below."""
    # Transposed images give the steps along columns: left is then above, right below.
    known = np.isfinite(disparity)
    joined = known[:, 1:] & known[:, :-1] & (np.abs(np.diff(disparity, axis=1)) <= _SAME_PX)
    row, _, end, start, _ = successive_runs(joined, _LEAST_RUN_PX, _MOST_GAP_PX)
    run = np.arange(_LEAST_RUN_PX)
    before = disparity[row[:, None], end[:, None] - _LEAST_RUN_PX + run]
    after = disparity[row[:, None], start[:, None] + run]
    first, second = np.median(before[:, -_END_PX:], axis=1), np.median(after[:, :_END_PX], axis=1)
    low, high = np.minimum(first, second), np.maximum(first, second)
    step, right = high - low, first > second
    used = (step >= _LEAST_STEP_PX) & (high >= _LEAST_RATIO * low)
    used &= np.maximum(np.ptp(before, axis=1), np.ptp(after, axis=1)) <= _MOST_SLOPE * step
    column = np.where(right, end - 1, start)
    used[used] = goes_on(right[used], row[used], column[used], _MOST_SLANT_PX).all(axis=0)
    row, end, start, low, high, step = (v[used] for v in (row, end, start, low, high, step))
    beside = np.arange(-_BESIDE_PX, _BESIDE_PX)
    near = np.stack([end[:, None] + beside, start[:, None] + beside], axis=1)
    around = disparity[row[:, None, None], near]
    around[:, 1][near[:, 1] < end[:, None] + _BESIDE_PX] = np.nan  # counted once
    margin = _BETWEEN * step
    between = (around > (low + margin)[:, None, None]) & (around < (high - margin)[:, None, None])
    missing = np.cumsum(np.pad(~known, ((0, 0), (1, 0))), axis=1)
    return Steps(
        right[used],
        start - end,
        missing[row, start] - missing[row, end],
        step,
        np.isfinite(around).sum(axis=(1, 2)),
        between.sum(axis=(1, 2)),
    )


def measure_gaps(found: Sequence[Steps], right: bool) -> tuple[float, float]:
    """Measure the gaps on one side of foregrounds, except gaps that contain other surfaces.

    Returns medians of the width, px, and of the width over the difference of disparity; NaN with
    fewer than LEAST_STEPS steps.
    """
    use = [(s.right == right) & (s.gap == s.empty) for s in found]
    width = np.concatenate([s.gap[u] for s, u in zip(found, use, strict=True)])
    step = np.concatenate([s.step[u] for s, u in zip(found, use, strict=True)])
    if width.size < LEAST_STEPS:
        return float("nan"), float("nan")
    return float(np.median(width)), float(np.median(width / step))


def between_share(found: Sequence[Steps]) -> float:
    """Compute the share of pixels within 3 px of a step whose depth is between the surfaces."""
    if sum(s.step.size for s in found) < LEAST_STEPS:
        return float("nan")
    return float(sum(s.between.sum() for s in found) / sum(s.near.sum() for s in found))


def border_band(disparity: Sequence[Array]) -> tuple[float, float]:
    """Measure the band without disparity (px, NaN) at the left border; flip columns for the right.

    Returns medians over the rows of the band's width, px, and of its width minus the disparity of
    the surface there; NaN with fewer than LEAST_ROWS rows.
    """
    rows = np.concatenate(disparity)
    first = np.isfinite(rows).argmax(axis=1)
    place = np.minimum(first[:, None] + np.arange(_BORDER_PX), rows.shape[1] - 1)
    surface = np.take_along_axis(rows, place, axis=1)
    whole = np.ptp(surface, axis=1) <= _SAME_PX * _BORDER_PX  # False with a hole
    if whole.sum() < LEAST_ROWS:
        return float("nan"), float("nan")
    width, surface = first[whole], surface[whole]
    return float(np.median(width)), float(np.median(width - np.median(surface, axis=1)))
