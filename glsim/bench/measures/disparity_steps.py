"""Steps between two surfaces in disparity: gaps without depth, pixels between, the image's border.

A camera pair cannot match what one of its imagers does not see: beside a foreground a stripe of the
background as wide as the difference of the two disparities has no depth, and so has a band at one
border of the image, as wide as the disparity there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
#: Pixels on each side of a step among which those between the surfaces are counted.
_BESIDE_PX = 3
#: Between: farther than this share of the step from either surface.
_BETWEEN = 0.15
#: A step goes on in the rows above and below, at most so many px away.
_MOST_SLANT_PX = 2
#: Fewest steps of a side, and fewest rows of a border, of a figure; chosen.
LEAST_STEPS, LEAST_ROWS = 20, 20
#: Pixels at the border of a band whose median is the disparity there.
_BORDER_PX = 6


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of an image along its rows; (N,) arrays with an entry per row and side.

    Attributes:
        right: whether the gap is to the right of the foreground, else to its left.
        row: row of the step.
        column: column of the last foreground pixel.
        gap: pixels between the two surfaces.
        empty: those of them without disparity.
        step: difference of the disparities: the width of a shadow of the whole baseline, px.
        near: pixels with disparity within 3 px of the step.
        between: those of them that lie between the surfaces.

    """

    right: NDArray[np.bool_]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    gap: NDArray[np.int64]
    empty: NDArray[np.int64]
    step: Array
    near: NDArray[np.int64]
    between: NDArray[np.int64]


@dataclass(frozen=True)
class Gaps:
    """The gaps on one side of foregrounds, without those that hold other surfaces.

    Attributes:
        steps: their number.
        width_px: median width; NaN with fewer than LEAST_STEPS.
        step_px: median difference of disparity.
        relative: median of width over difference of disparity.

    """

    steps: int
    width_px: float
    step_px: float
    relative: float


def find_steps(disparity: Array) -> Steps:
    """Find the steps of an image along its rows.

    Args:
        disparity: (H, W) px, NaN = none. Transpose it for the steps along columns: left is then
            above, right below.

    """
    found = [entry for row, line in enumerate(disparity) for entry in _row_steps(line, row)]
    table = np.array(found, np.float64).reshape(-1, 8)
    table = table[_goes_on(table)]
    right, row, column, gap, empty, near, between = np.delete(table, 5, axis=1).astype(np.int64).T
    return Steps(right > 0, row, column, gap, empty, table[:, 5], near, between)


def _row_steps(line: Array, row: int) -> list[tuple[float, ...]]:
    known = np.isfinite(line)
    with np.errstate(invalid="ignore"):
        same = known[1:] & known[:-1] & (np.abs(np.diff(line)) <= _SAME_PX)
    joined = np.concatenate([[False], same, [False]])
    starts = np.flatnonzero(joined[1:] & ~joined[:-1])
    ends = np.flatnonzero(~joined[1:] & joined[:-1]) + 1
    long = ends - starts >= _LEAST_RUN_PX
    starts, ends = starts[long], ends[long]
    steps: list[tuple[float, ...]] = []
    for end, start in zip(ends[:-1].tolist(), starts[1:].tolist(), strict=True):
        before, after = line[end - _LEAST_RUN_PX : end], line[start : start + _LEAST_RUN_PX]
        first, second = float(np.median(before[-_END_PX:])), float(np.median(after[:_END_PX]))
        low, high = sorted((first, second))
        step = high - low
        if step < _LEAST_STEP_PX or high < _LEAST_RATIO * low or start - end > _MOST_GAP_PX:
            continue
        if max(np.ptp(before), np.ptp(after)) > _MOST_SLOPE * step:
            continue
        middle = min(end + _BESIDE_PX, start)
        around = np.concatenate(
            [line[end - _BESIDE_PX : middle], line[max(start - _BESIDE_PX, middle) : start + 3]]
        )
        around = around[np.isfinite(around)]
        margin = _BETWEEN * step
        between = (around > low + margin) & (around < high - margin)
        right = first > second
        gap = line[end:start]
        steps.append(
            (
                float(right), float(row), float(end - 1 if right else start), float(gap.size),
                float(np.isnan(gap).sum()), step, float(around.size), float(between.sum()),
            )
        )  # fmt: skip
    return steps


def _goes_on(table: Array) -> NDArray[np.bool_]:
    """Keep the steps that the rows above and below have as well."""
    places: dict[tuple[float, float], list[float]] = {}
    for right, row, column in table[:, :3]:
        places.setdefault((right, row), []).append(column)
    keep = [
        all(
            any(abs(other - column) <= _MOST_SLANT_PX for other in places.get((right, row + k), ()))
            for k in (-1, 1)
        )
        for right, row, column in table[:, :3]
    ]
    return np.array(keep, np.bool_)


def measure_gaps(found: Sequence[Steps], right: bool) -> Gaps:
    """Measure the width of the gaps beside foregrounds, px, on one side.

    Args:
        found: the steps of each frame.
        right: which side.

    """
    use = [(s.right == right) & (s.gap == s.empty) for s in found]
    width = np.concatenate([np.zeros(0), *(s.gap[u] for s, u in zip(found, use, strict=True))])
    step = np.concatenate([np.zeros(0), *(s.step[u] for s, u in zip(found, use, strict=True))])
    if width.size < LEAST_STEPS:
        return Gaps(int(width.size), *(float("nan"),) * 3)
    medians = (float(np.median(values)) for values in (width, step, width / step))
    return Gaps(int(width.size), *medians)


def between_share(found: Sequence[Steps]) -> float:
    """Return the share of the pixels within 3 px of a step that lie between the surfaces."""
    if sum(s.step.size for s in found) < LEAST_STEPS:
        return float("nan")
    return float(sum(s.between.sum() for s in found) / sum(s.near.sum() for s in found))


def border_band(disparity: Sequence[Array]) -> tuple[float, float]:
    """Measure the band without disparity at the left border.

    Args:
        disparity: (H, W) of each frame, px, NaN = none. Flip the columns for the right border.

    Returns:
        Medians over the rows of the band's width, px, and of its width minus the disparity of the
        surface there; NaN with fewer than LEAST_ROWS rows.

    """
    widths, rest = [], []
    for image in disparity:
        known = np.isfinite(image)
        first = known.argmax(axis=1)
        for row in np.flatnonzero(known.any(axis=1)):
            surface = image[row, first[row] : first[row] + _BORDER_PX]
            if np.isfinite(surface).all() and np.ptp(surface) <= _SAME_PX * surface.size:
                widths.append(float(first[row]))
                rest.append(float(first[row] - np.median(surface)))
    if len(widths) < LEAST_ROWS:
        return float("nan"), float("nan")
    return float(np.median(widths)), float(np.median(rest))
