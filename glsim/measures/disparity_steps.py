"""Disparity steps between two surfaces: gaps without depth, depths in between, border band.

A stereo camera cannot match pixels that only one imager sees. Beside a foreground, a stripe of the
background has no depth; its width is the difference of the two disparities. A band at one border of
the image has no depth either; its width is the disparity there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Array, Mask, Whole
from glsim.measures.pixel_runs import goes_on, successive_runs

#: Largest difference of neighbours on one surface, px of disparity. Chosen: 8 times a D400's noise.
_SAME_PX = 1.0
#: Smallest difference, px, and smallest ratio of the disparities at a step. Chosen: 4 _SAME_PX.
_LEAST_STEP_PX, _LEAST_RATIO = 4.0, 1.15
#: Smallest width of both surfaces, px; number of end pixels whose median is the disparity.
_LEAST_RUN_PX, _END_PX = 10, 5
#: Largest change of a surface within _LEAST_RUN_PX, as a share of the step: slopes are no steps.
_MOST_SLOPE = 0.25
#: Widest gap, px; a wider one is an object without depth. Chosen: the shadow of a hand at 0.3 m.
_MOST_GAP_PX = 80
#: Pixels within this distance of a step, px, are searched for depths between the surfaces.
_BESIDE_PX = 3
#: A depth is "between" if its distance from both surfaces is above this share of the step.
_BETWEEN = 0.15
#: Largest shift of a step from one row to the next, px.
_MOST_SLANT_PX = 2
#: Smallest number of steps of a side, and of rows of a border, for a figure; chosen.
LEAST_STEPS, LEAST_ROWS = 20, 20
#: Number of pixels beside a border band whose median is the disparity there.
_BORDER_PX = 6


class Steps(NamedTuple):
    """Disparity steps along the rows of an image; (N,) arrays with an entry per row and side.

    Attributes:
        right: whether the gap is to the right of the foreground, otherwise to its left.
        gap: number of pixels between the two surfaces.
        empty: number of these pixels without disparity.
        step: difference of the disparities, px, the width of a shadow with the whole baseline.
        near: number of pixels with disparity within 3 px of the step.
        between: number of these pixels that lie between the surfaces.
    """

    right: Mask
    gap: Whole
    empty: Whole
    step: Array
    near: Whole
    between: Whole


def find_steps(disparity: Array) -> Steps:
    """Find steps along rows of (H, W) disparity, px, that continue in the rows above and below."""
    # A transposed image gives the steps along columns: left is then above, right is below.
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
        right[used], start - end, missing[row, start] - missing[row, end], step,
        np.isfinite(around).sum(axis=(1, 2)), between.sum(axis=(1, 2)),
    )  # fmt: skip


def measure_gaps(found: Sequence[Steps], right: bool) -> tuple[float, float]:
    """Measure the gaps on one side of foregrounds, without gaps that contain other surfaces.

    Returns the median width, px, and the median of width over difference of disparity; NaN with
    fewer than LEAST_STEPS steps.
    """
    every = [np.stack([s.gap, s.step])[:, (s.right == right) & (s.gap == s.empty)] for s in found]
    width, step = np.concatenate(every, axis=1)
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

    Returns medians over the rows: the band's width, px, and its width minus the disparity of the
    surface beside it; NaN with fewer than LEAST_ROWS rows.
    """
    rows = np.concatenate(disparity)
    first = np.isfinite(rows).argmax(axis=1)
    place = np.minimum(first[:, None] + np.arange(_BORDER_PX), rows.shape[1] - 1)
    surface = np.take_along_axis(rows, place, axis=1)
    whole = np.ptp(surface, axis=1) <= _SAME_PX * _BORDER_PX  # False for a row with a hole
    if whole.sum() < LEAST_ROWS:
        return float("nan"), float("nan")
    width, surface = first[whole], surface[whole]
    return float(np.median(width)), float(np.median(width - np.median(surface, axis=1)))
