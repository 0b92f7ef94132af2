"""Silhouettes along rows: the gaps between foreground and background on both sides.

A run is five or more pixels of a row with depth, each near its neighbour. If the ends of two
successive runs differ by more than 100 mm, the nearer run is the foreground, and the pixels between
the runs are the gap. "right" and "left" give the side of the foreground on which the gap lies. The
emitter's shadow, S = f (1/z_front - 1/z_back) B px for a baseline of B m, widens one side's gaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.core.array_types import Array, Floats, Mask, Whole
from glsim.core.depth_frame import DepthFrame
from glsim.core.depth_map import MEASURED_STEP
from glsim.core.units import MM_PER_M
from glsim.measures.measured_frame import radius_px
from glsim.measures.pixel_runs import goes_on, successive_runs

#: Smallest depth step between the two runs of a silhouette, mm.
STEP_MM = 100.0
#: Smallest length of a run, px; flying pixels make shorter runs.
_LEAST_RUN = 5
#: Smallest width of foreground and background, px; chosen to leave out thin chair legs.
_LEAST_FRONT, _LEAST_BACK = 10, 12
#: Widest gap, px; a wider one is a hole or an object without depth.
_MOST_GAP = 40
#: Largest shift of an edge from one row to the next, px: within 63 degrees of upright.
_MOST_SLANT = 2
#: Width of the band outside the foreground, px.
BAND_PX = 8
#: Distance from the gap, px, at which the background's infrared is read.
_BESIDE_PX = 3
#: Depth counts as behind the background if it is farther by more than this, mm.
_BEHIND_MM = 50.0
#: Range of S of the measured edges, px per m of baseline. Chosen: 200 is a head at 0.9 m before a
#: wall at 1.8 m; below 100 a shadow is no wider than the gap on the lit side.
HEAD_SHIFTS = (100.0, 500.0)
_LEAST_EDGES = 50
#: Number of steps of reweighted least squares, and residual, px, below which all points have the
#: same weight. The values were chosen, not measured.
_FIT_STEPS, _LEAST_RESIDUAL = 30, 0.1


@dataclass(frozen=True, eq=False)
class Edges:
    """Silhouettes of one frame; (N,) arrays with an entry per row and side.

    Attributes:
        side: 0 for a gap to the left of the foreground, 1 for a gap to the right.
        row, column: position of the last foreground pixel.
        width: number of pixels of the gap.
        invalid: number of pixels of the gap without depth.
        band_invalid: share of the next BAND_PX pixels outside the foreground without depth.
        band_behind: share of these pixels whose depth is behind the background.
        front_mm, back_mm: depth at the end of foreground and background.
        shift_px_per_m: S for a baseline of 1 m.
        radius_px: distance of the edge from the principal point, px of a Kinect V2.
        back_counts: infrared of the background beside the gap, counts; 0 without infrared.
    """

    side: Whole
    row: Whole
    column: Whole
    width: Array
    invalid: Array
    band_invalid: Array
    band_behind: Array
    front_mm: Array
    back_mm: Array
    shift_px_per_m: Array
    radius_px: Floats
    back_counts: Array


@dataclass(frozen=True)
class Side:
    """Gaps on one side of silhouettes with a shift S within HEAD_SHIFTS.

    Attributes:
        width_px, width_mean_px: median and mean width of the gaps.
        invalid_px: median number of pixels without depth.
        band_invalid: share of the next BAND_PX pixels outside the foreground without depth.
        band_behind: share of these pixels whose depth is behind the background.
        offset_px: constant of width = offset + slope S, fitted to edges of any S.
        slope_mm: slope of this line, the effective baseline of this side.
    """

    edges: int
    width_px: float
    width_mean_px: float
    invalid_px: float
    band_invalid: float
    band_behind: float
    offset_px: float
    slope_mm: float


@dataclass(frozen=True)
class Silhouettes:
    """Gaps on both sides; ``shadow_side`` is the side with wider gaps, "left" or "right"."""

    left: Side
    right: Side
    shadow_side: str

    @property
    def lit_and_shadow(self) -> tuple[Side, Side]:
        """The side with the narrower gaps, and the side with the wider gaps."""
        pair = self.left, self.right
        return pair if self.shadow_side == "right" else pair[::-1]


def measure_silhouettes(
    frames: Sequence[DepthFrame],
    ring_px: tuple[float, float] = (0.0, np.inf),
    light: tuple[float, float] = (-np.inf, np.inf),
) -> Silhouettes:
    """Measure the gaps on both sides; NaN for a side with fewer than 50 edges.

    ``ring_px`` is the range of the edges' distances from the principal point, px of a Kinect V2.
    ``light`` is the range of the background's infrared, counts; it is 0 without infrared.
    """
    found = [find_edges(frame) for frame in frames]
    left, right = (_side(found, number, ring_px, light) for number in (0, 1))
    widths = np.nan_to_num([left.width_mean_px, right.width_mean_px])
    return Silhouettes(left, right, "left" if widths[0] > widths[1] else "right")


def find_edges(frame: DepthFrame) -> Edges:
    """Find the silhouettes along a frame's rows that continue in the row above or below."""
    z = frame.measured_mm
    known = np.isfinite(z)
    joined = known[:, 1:] & known[:, :-1]
    joined &= np.abs(np.diff(z, axis=1)) <= MEASURED_STEP.limit_mm(np.nan_to_num(z[:, 1:]))
    row, start, end, next_start, next_end = successive_runs(joined, _LEAST_RUN, _MOST_GAP)
    # The depth at an end is the median of the four pixels inside the outermost one.
    ends = (end[:, None] + np.arange(-5, -1), next_start[:, None] + np.arange(1, 5))
    left, right = (np.median(z[row[:, None], at].astype(np.float64), axis=1) for at in ends)
    on_right = left < right  # the foreground is on the left, the gap on its right
    widths = end - start, next_end - next_start
    band = np.where(on_right, end, next_start - BAND_PX)[:, None] + np.arange(BAND_PX)
    used = (np.abs(right - left) > STEP_MM) & (band[:, 0] >= 0) & (band[:, -1] < z.shape[1])
    used &= np.where(on_right, *widths) >= _LEAST_FRONT
    used &= np.where(on_right, *widths[::-1]) >= _LEAST_BACK
    column = np.where(on_right, end - 1, next_start)
    used[used] = goes_on(on_right[used], row[used], column[used], _MOST_SLANT).any(axis=0)
    back = np.where(on_right, next_start + _BESIDE_PX, end - 1 - _BESIDE_PX)[used]
    row, end, next_start, column = (v[used] for v in (row, end, next_start, column))
    front_mm, back_mm = np.sort([left[used], right[used]], axis=0)
    missing = np.cumsum(np.pad(~known, ((0, 0), (1, 0))), axis=1)
    outside = np.nan_to_num(z[row[:, None], band[used]])
    return Edges(
        on_right[used].astype(np.int64), row, column, np.asarray(next_start - end, np.float64),
        np.asarray(missing[row, next_start] - missing[row, end], np.float64),
        (~known[row[:, None], band[used]]).mean(axis=1),
        (outside > back_mm[:, None] + _BEHIND_MM).mean(axis=1), front_mm, back_mm,
        frame.intrinsics.fx * (MM_PER_M / front_mm - MM_PER_M / back_mm),
        radius_px(frame)[row, column],
        np.zeros(row.size) if frame.infrared is None else frame.infrared[row, back].astype("f8"),
    )  # fmt: skip


def _side(
    found: Sequence[Edges], number: int, ring_px: tuple[float, float], light: tuple[float, float]
) -> Side:
    def column(name: str, of: Mask | slice = slice(None)) -> Array:
        return np.asarray(np.concatenate([getattr(e, name) for e in found])[of])

    shift, radius, counts = map(column, ("shift_px_per_m", "radius_px", "back_counts"))
    own = (column("side") == number) & (radius >= ring_px[0]) & (radius < ring_px[1])
    own &= (counts >= light[0]) & (counts < light[1])
    used = own & (shift >= HEAD_SHIFTS[0]) & (shift <= HEAD_SHIFTS[1])
    width = column("width", used)
    if width.size < _LEAST_EDGES:
        return Side(int(width.size), *(float("nan"),) * 7)
    offset, slope = _line(shift[own], column("width", own))
    return Side(
        int(width.size), _median_of_counts(width), float(width.mean()),
        _median_of_counts(column("invalid", used)), float(column("band_invalid", used).mean()),
        float(column("band_behind", used).mean()), offset, MM_PER_M * slope,
    )  # fmt: skip


def _median_of_counts(counts: Array) -> float:
    """Compute the median of integers as if each were spread evenly over +-0.5."""
    middle = float(np.median(counts))
    below, same = float((counts < middle).mean()), float((counts == middle).mean())
    return middle - 0.5 + (0.5 - below) / same if same > 0 else middle


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Fit y = offset + slope x by least absolute deviations; NaN if x hardly varies."""
    if x.size < _LEAST_EDGES or float(np.subtract(*np.percentile(x, (90, 10)))) < 30.0:
        return float("nan"), float("nan")
    design = np.column_stack([np.ones_like(x), x])
    weight: Array = np.ones_like(x)
    fit: Array = np.zeros(2)
    for _ in range(_FIT_STEPS):
        solved = np.linalg.lstsq(design * weight[:, None], y * weight, rcond=None)
        fit = np.asarray(solved[0], np.float64)
        weight = 1.0 / np.sqrt(np.maximum(np.abs(y - design @ fit), _LEAST_RESIDUAL))
    return float(fit[0]), float(fit[1])
