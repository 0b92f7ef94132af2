"""Rims of surfaces along rows or columns: the gap, the pixels between, and how depth bends there.

A rim is a place where two runs of pixels with depth follow each other, at most MOST_GAP_PX apart,
and the farther one is more than STEP times as far. Each run has a line fitted to its pixels 5 to 10
from the rim; the bend is how far the outermost pixels lie beyond that line: negative towards the
camera. Phasors of two surfaces in one pixel bend it either way; a mean of depths would only
draw the surfaces together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Ratio of the two depths from which on a step is a rim.
STEP = 1.15
#: Widest gap, px; the shadow of an emitter beside the camera is wider in few scenes.
MOST_GAP_PX = 25
#: Outermost pixels of a run whose bend counts, and the pixels of its line.
OUTER_PX, LINE_PX = 3, (5, 10)
#: Pixels on either side of a step among which those between the surfaces are counted.
BAND_PX = 3
#: Largest root mean square about its line, mm per m of depth, of a run that counts as smooth.
_ROUGH_MM_PER_M = 4.0
#: A pixel lies between if it is farther from both surfaces than this share of their distance.
_BETWEEN = 0.15


@dataclass(frozen=True, eq=False)
class Rims:
    """The rims of one frame; (N,) arrays with an entry per rim.

    Attributes:
        right: whether the gap is to the right of the foreground (below it, for columns).
        line: row (or column) that was scanned.
        gap_px: pixels without depth, or off both surfaces, between the two runs.
        front_mm: depth of the foreground at the rim, by its line.
        back_mm: depth of the background there, by its line.
        front_bend_mm: (N, OUTER_PX) bend of the foreground's pixels, the outermost first.
        back_bend_mm: the same of the background's.
        between: pixels of the band that lie between the surfaces.
    """

    right: NDArray[np.bool_]
    line: NDArray[np.int64]
    gap_px: Array
    front_mm: Array
    back_mm: Array
    front_bend_mm: Array
    back_bend_mm: Array
    between: Array

    def where(self, chosen: NDArray[np.bool_]) -> Rims:
        """Return some of the rims.

        Args:
            chosen: (N,) bool.
        """
        return Rims(*(value[chosen] for value in vars(self).values()))

    @property
    def between_share(self) -> float:
        """Share of the pixels within BAND_PX px of the steps that lie between the surfaces."""
        return float(self.between.mean() / (2 * BAND_PX)) if self.between.size else float("nan")


def find_rims(depth_mm: NDArray[np.floating], *, columns: bool = False) -> Rims:
    """Find where a surface ends before a farther one, and how its depth bends there, mm.

    Args:
        depth_mm: (H, W) depth, mm; 0 or NaN where there is none.
        columns: scan along columns instead of rows.

    Returns:
        The rims whose runs are smooth on both sides.
    """
    depth = np.nan_to_num(np.asarray(depth_mm, np.float64))
    scans = depth.T if columns else depth
    found = [entry for number, z in enumerate(scans) for entry in _rims_of(z, number)]
    columns_of: list[tuple[object, ...]] = list(zip(*found, strict=True)) or [()] * 8

    def numbers(field: int) -> Array:
        return np.array(columns_of[field], np.float64)

    return Rims(
        right=np.array(columns_of[0], np.bool_),
        line=np.array(columns_of[1], np.int64),
        gap_px=numbers(2),
        front_mm=numbers(3),
        back_mm=numbers(4),
        front_bend_mm=numbers(5).reshape(-1, OUTER_PX),
        back_bend_mm=numbers(6).reshape(-1, OUTER_PX),
        between=numbers(7),
    )


def _rims_of(z: Array, number: int) -> list[tuple[object, ...]]:
    """Return the fields of Rims for each rim of one row."""
    # Neighbours belong to one run where their depths differ by less than a tenth.
    joined = (z[1:] > 0) & (z[:-1] > 0)
    joined &= np.abs(np.diff(z)) < 0.1 * np.minimum(z[1:], z[:-1])
    edges = np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)  # the last pixels
    long = ends - starts >= LINE_PX[1]
    starts, ends = starts[long], ends[long]
    found: list[tuple[object, ...]] = []
    for last, first in zip(ends[:-1], starts[1:], strict=True):
        if first - last - 1 > MOST_GAP_PX:
            continue
        left, right = _run_line(z, last, -1), _run_line(z, first, 1)
        if left is None or right is None:
            continue
        (left_mm, left_bend), (right_mm, right_bend) = left, right
        near, far = min(left_mm, right_mm), max(left_mm, right_mm)
        if far < STEP * near:
            continue
        leaves = left_mm < right_mm  # the foreground is to the left, the gap to its right
        middle = (last + first + 1) // 2
        band = z[max(middle - BAND_PX, 0) : middle + BAND_PX]
        margin = _BETWEEN * (far - near)
        between = int(((band > near + margin) & (band < far - margin)).sum())
        bends = (left_bend, right_bend) if leaves else (right_bend, left_bend)
        found.append((leaves, number, first - last - 1, near, far, *bends, between))
    return found


def _run_line(z: Array, end: int, step: int) -> tuple[float, Array] | None:
    """Return the depth of a run at its end by the line, and the bends; None for a rough run.

    Args:
        z: (W,) depth of the row, mm.
        end: column of the outermost pixel.
        step: +1 if the run goes on to the right of it, otherwise -1.
    """
    away = np.arange(*LINE_PX)
    inner = z[end + step * away]
    if inner.min() <= 0:
        return None
    slope, at_end = np.polyfit(away, inner, 1)
    residual = inner - (at_end + slope * away)
    if np.sqrt((residual**2).mean()) > _ROUGH_MM_PER_M * at_end / 1000.0 or at_end <= 0:
        return None
    outer = np.arange(OUTER_PX)
    return float(at_end), z[end + step * outer] - (at_end + slope * outer)
