"""Runs of same-surface pixels along image rows, and the steps between them."""

from __future__ import annotations

import numpy as np

from glsim.core.array_types import Mask, Whole


def successive_runs(joined: Mask, least_px: int, most_gap_px: int) -> Whole:
    """Find the pairs of successive runs of at least ``least_px`` pixels in each row.

    ``joined`` is (H, W - 1): whether a pixel and its right neighbour lie on one surface. Returns
    (5, N): row; first pixel of the left run, and the pixel after its last; first pixel of the right
    run, and the pixel after its last.
    """
    padded = np.pad(joined, ((0, 0), (1, 1)))
    row, start = np.nonzero(padded[:, 1:] & ~padded[:, :-1])
    end = np.nonzero(~padded[:, 1:] & padded[:, :-1])[1] + 1
    row, start, end = np.stack([row, start, end])[:, end - start >= least_px]
    pair = (row[1:] == row[:-1]) & (start[1:] - end[:-1] <= most_gap_px)
    return np.stack([row[1:], start[:-1], end[:-1], start[1:], end[1:]])[:, pair]


def goes_on(right: Mask, row: Whole, column: Whole, most_px: int) -> Mask:
    """Mark steps that continue, within ``most_px`` columns, in the row above and below, (2, N).

    ``right`` is (N,): whether the farther surface is on the right of the step.
    """
    key = (right.astype(np.int64) << 40) + (row << 20) + column
    ordered = np.sort(key)
    above_below = key + np.array([[-1], [1]]) * (1 << 20)
    last = np.searchsorted(ordered, above_below + most_px, "right")
    return np.asarray(last > np.searchsorted(ordered, above_below - most_px))
