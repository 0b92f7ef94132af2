"""Measure the fixed pattern of one device: its parts and its map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.pattern import measure_pattern
from glsim.core.depth_frame import DepthFrame
from glsim.sensors.images import LARGEST_MM

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Side of the window whose best plane is subtracted for the map, px; chosen. Errors that are smooth
#: over more pixels cannot be told from the scene's shape.
MAP_WINDOW_PX = 15
_LEAST_WINDOW = 0.2


@dataclass(frozen=True, eq=False)
class DevicePattern:
    """The fixed pattern of one device; a part that the recording does not show is 0.

    Attributes:
        alternation_mm: half the even-odd difference of rows in the upper half of the image; the
            lower half has the opposite sign.
        row_step_mm: odd minus even rows, alike in both halves.
        row_mm: standard deviation of rows beyond that.
        column_mm: standard deviation of columns.
        pixel_mm: standard deviation of single pixels.
        pixel_correlation: correlation of these at 1 px, as ``FixedPattern.rest_correlation``.
        map_mm: (H, W) float32, the pattern itself, NaN where the scene is not smooth.

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
        parts = (self.alternation_mm, self.row_step_mm / 2.0, self.row_mm, self.column_mm,
                 self.pixel_mm)  # fmt: skip
        return float(np.linalg.norm(parts))


def describe_pattern(halves: Sequence[DepthFrame], mean_mm: Array, used: Mask) -> DevicePattern:
    """Measure the parts of the pattern as ``glsim compare`` does, and the map.

    Args:
        halves: means of the even and of the odd frames; only what both share is pattern.
        mean_mm: (H, W) mean of all frames.
        used: (H, W) pixels of smooth surfaces.

    """
    found = measure_pattern(halves)
    bands = np.array(found.alternation_mm)  # half steps of odd rows, from the top to the bottom
    upper, lower = (_mean(part) for part in np.array_split(bands, 2))
    own_rows = found.rows_mm**2 - found.alternation_rms_mm**2
    return DevicePattern(
        0.5 * (lower - upper),
        upper + lower,
        float(np.sqrt(max(own_rows, 0.0))) if np.isfinite(own_rows) else 0.0,
        float(np.nan_to_num(found.columns_mm)),
        float(np.nan_to_num(found.rest_mm)),
        float(np.nan_to_num(found.rest_correlation)),
        pattern_map(mean_mm, used),
    )


def _mean(values: Array) -> float:
    """Average the finite values; 0 without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else 0.0


def pattern_map(mean_mm: Array, used: Mask) -> NDArray[np.float32]:
    """Return (H, W) depth minus the best plane of each window of MAP_WINDOW_PX, mm.

    NaN where less than a fifth of the window is usable, and beyond LARGEST_MM, which no pattern
    reaches.
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
