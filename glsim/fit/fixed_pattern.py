"""Measure a camera's fixed pattern: errors that are the same in every frame, by rows and pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.sensors.pattern_map import LARGEST_MM

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Distance of the pixels in a difference: beyond the reach of two 3 x 3 filters, and even, so that
#: an alternation of rows cancels.
LAG_PX = 4

#: Pixels this far apart share the error of their row or column, but no error of single pixels.
_FAR_PX = range(5, 17)

#: Side of the window whose best plane is subtracted for the map: errors that are smooth over more
#: pixels (wiggling, the scene's own curvature) are not told from the scene.
MAP_WINDOW_PX = 15
_LEAST_WINDOW = 0.2


@dataclass(frozen=True, eq=False)
class FixedPattern:
    """The fixed pattern of one device.

    alternation_mm: half difference of even and odd rows that changes its sign at the middle row,
    above it. row_step_mm: odd minus even rows, the same above and below. row_mm,
    column_mm: standard deviation of the error shared by a row or column beyond that; pixel_mm: of
    the rest, of single pixels. pixel_correlation: correlation of the rest at 1 px; 0 if it is
    white, 0.67 if it is smoothed over 3 x 3. map_mm: (H, W) float32, the pattern itself, NaN where
    the scene is not smooth.
    """

    alternation_mm: float
    row_step_mm: float
    row_mm: float
    column_mm: float
    pixel_mm: float
    pixel_correlation: float
    map_mm: NDArray[np.float32]

    @property
    def known_share(self) -> float:
        """Share of the pixels that the map knows."""
        return float(np.isfinite(self.map_mm).mean())

    @property
    def total_mm(self) -> float:
        """Standard deviation of all parts together."""
        parts = (
            self.alternation_mm,
            self.row_step_mm / 2.0,
            self.row_mm,
            self.column_mm,
            self.pixel_mm,
        )
        return float(np.linalg.norm(parts))


def measure_pattern(mean_mm: Array, halves_mm: tuple[Array, Array], used: Mask) -> FixedPattern:
    """Measure all parts of the pattern.

    mean_mm: (H, W) mean over all frames. halves_mm: the same of two halves of the frames; only
    what both share is pattern, so that the temporal noise left in a mean does not count. used:
    (H, W), True on smooth surfaces; all three images are finite there.
    """
    down = _Products(halves_mm, used, 0)
    across = _Products(halves_mm, used, 1)
    # The variance of a second difference of independent pixels is six times theirs.
    row, column = down.far / 6.0, across.far / 6.0
    pixel = 0.5 * ((down.here - down.far) + (across.here - across.far)) / 6.0
    beside = 0.5 * ((down.beside - down.far) + (across.beside - across.far)) / 6.0
    alternation_mm, row_step_mm = _alternation(mean_mm, used)
    return FixedPattern(
        alternation_mm,
        row_step_mm,
        _root(row),
        _root(column),
        _root(pixel),
        float(np.clip(beside / pixel, -1.0, 1.0)) if pixel > 0 else 0.0,
        pattern_map(mean_mm, used),
    )


class _Products:
    """Mean products of the second differences of both halves along an axis, mm^2.

    here: of a pixel; beside, far: of pixels 1 px and _FAR_PX apart across the axis.
    """

    def __init__(self, halves_mm: tuple[Array, Array], used: Mask, axis: int) -> None:
        bends = [
            np.where(used, second_difference(half, axis, LAG_PX), np.nan) for half in halves_mm
        ]
        kept = used & np.isfinite(bends[0]) & np.isfinite(bends[1])
        mean = 0.5 * (bends[0] + bends[1])
        middle = float(np.median(mean[kept])) if kept.any() else 0.0
        spread = 1.4826 * float(np.median(np.abs(mean[kept] - middle))) if kept.any() else 0.0
        kept &= np.abs(mean - middle) <= 5.0 * max(spread, 1e-6)
        self._first, self._second = (np.where(kept, b - middle, 0.0) for b in bends)
        self._kept, self._across = kept, 1 - axis
        self.here = self._product((0,))
        self.beside = self._product((1,))
        self.far = self._product(_FAR_PX)

    def _product(self, lags: tuple[int, ...] | range) -> float:
        total, count = 0.0, 0
        for lag in lags:
            a, b, kept = (
                np.moveaxis(x, self._across, 0) for x in (self._first, self._second, self._kept)
            )
            end = len(a) - lag
            total += float((a[:end] * b[lag:]).sum() + (b[:end] * a[lag:]).sum())
            count += 2 * int((kept[:end] & kept[lag:]).sum())
        return total / count if count else 0.0


def _alternation(mean_mm: Array, used: Mask) -> tuple[float, float]:
    """Measure the rows' alternation: the part that changes its sign at the middle, and the step.

    Returns ``alternation_mm`` and ``row_step_mm`` of FixedPattern; 0 where a half shows no surface.
    """
    bend = np.where(used, second_difference(mean_mm, 0, 1), np.nan)
    bend[np.abs(bend) > 20.0] = np.nan  # no pattern, but the end of a surface
    sign = np.where(np.arange(len(bend)) % 2 == 0, 1.0, -1.0)
    # An alternation of +-a has second differences of -+4 a.
    even_minus_mean = -0.25 * sign[:, None] * bend
    middle = len(bend) // 2
    halves = [even_minus_mean[: middle - 1], even_minus_mean[middle + 1 :]]  # not across the middle
    if not all(np.isfinite(half).any() for half in halves):
        known = float(np.nanmean(even_minus_mean)) if np.isfinite(even_minus_mean).any() else 0.0
        return 0.0, -2.0 * known
    upper, lower = (float(np.nanmean(half)) for half in halves)
    return 0.5 * (upper - lower), -(upper + lower)


def pattern_map(mean_mm: Array, used: Mask) -> NDArray[np.float32]:
    """Subtract from each pixel the plane that fits its MAP_WINDOW_PX window best: (H, W), mm.

    NaN where less than a fifth of the window is usable, and beyond LARGEST_MM, which no pattern
    reaches: there the scene is not smooth.
    """
    inverse = np.where(used, 1000.0 / np.where(used, mean_mm, 1.0), 0.0)  # linear on a plane
    weight = used.astype(np.float64)
    rows, columns = np.mgrid[: mean_mm.shape[0], : mean_mm.shape[1]] / MAP_WINDOW_PX

    def mean(image: Array) -> Array:
        side = (MAP_WINDOW_PX, MAP_WINDOW_PX)
        return np.asarray(cv2.boxFilter(image, -1, side, borderType=cv2.BORDER_CONSTANT))

    share = mean(weight)
    enough = used & (share >= _LEAST_WINDOW)
    whole = np.where(share > 0, share, 1.0)
    x, y, w = (mean(weight * i) / whole for i in (columns, rows, inverse))
    xx, xy, yy = (
        mean(weight * a * b) / whole - m * n
        for a, b, m, n in (
            (columns, columns, x, x), (columns, rows, x, y), (rows, rows, y, y),
        )
    )  # fmt: skip
    xw = mean(weight * columns * inverse) / whole - x * w
    yw = mean(weight * rows * inverse) / whole - y * w
    enough &= xx * yy - xy**2 > 1e-6
    determinant = np.where(enough, xx * yy - xy**2, 1.0)
    along, down = (xw * yy - yw * xy) / determinant, (yw * xx - xw * xy) / determinant
    plane = w + along * (columns - x) + down * (rows - y)
    residual = (plane - inverse) * mean_mm**2 / 1000.0
    enough &= np.abs(residual) <= LARGEST_MM
    return np.where(enough, residual, np.nan).astype(np.float32)


def second_difference(image: Array, axis: int, lag: int) -> Array:
    """Compute image[i - lag] - 2 image[i] + image[i + lag]; NaN at the border."""
    moved = np.moveaxis(image, axis, 0)
    out = np.full(moved.shape, np.nan)
    out[lag:-lag] = moved[: -2 * lag] - 2 * moved[lag:-lag] + moved[2 * lag :]
    return np.moveaxis(out, 0, axis)


def _root(variance: float) -> float:
    return float(np.sqrt(max(variance, 0.0)))
