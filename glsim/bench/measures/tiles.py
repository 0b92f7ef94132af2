"""Noise of one frame over its infrared: residuals of planes in square tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.correlation import correlation_of, lagged_sums

Array = NDArray[np.float64]

#: Side of a tile whose noise is measured, and of one whose correlation is, px.
SIDE_PX, WIDE_PX = 12, 16
#: Largest spread of depths in a tile, mm; a wider one holds an edge.
_MOST_SPREAD_MM = 60.0
#: Lags of the correlation, px.
LAGS_PX = (1, 2, 3, 4)


@dataclass(frozen=True, eq=False)
class Tiles:
    """The planes of one frame, tiles that overlap by half.

    Attributes:
        infrared: (N,) median counts.
        rms_mm: (N,) root mean square of the residual, mm.
        residual_mm: (N, side, side) depth minus plane, mm.
    """

    infrared: Array
    rms_mm: Array
    residual_mm: Array

    def median_rms(self, limits: Sequence[float]) -> list[tuple[float, float, int]]:
        """Return infrared, residual, mm (medians), and number of tiles between the limits."""
        bins = []
        for low, high in pairwise(limits):
            inside = (self.infrared >= low) & (self.infrared < high)
            count = int(inside.sum())
            counts, rms = self.infrared[inside], self.rms_mm[inside]
            medians = (float(np.median(counts)), float(np.median(rms))) if count else (0.0, 0.0)
            bins.append((*medians, count))
        return bins

    def correlation(self, low: float, high: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the correlation at LAGS_PX along rows and columns.

        Args:
            low: least infrared of the tiles, counts.
            high: largest infrared.
        """
        inside = (self.infrared >= low) & (self.infrared < high)
        images = self.residual_mm[inside]
        rows = correlation_of([lagged_sums(images, [(0, lag) for lag in LAGS_PX])])
        columns = correlation_of([lagged_sums(images, [(lag, 0) for lag in LAGS_PX])])
        return rows, columns


def plane_tiles(
    depth_mm: NDArray[np.floating], infrared: NDArray[np.floating], side_px: int = SIDE_PX
) -> Tiles:
    """Fit planes to all tiles of a frame that are full of depth and hold no edge.

    Args:
        depth_mm: (H, W) depth, mm; 0 or NaN where there is none.
        infrared: (H, W) counts.
        side_px: of a tile.
    """
    depth = np.nan_to_num(np.asarray(depth_mm, np.float64))
    y, x = np.indices((side_px, side_px)) - (side_px - 1) / 2
    base = np.column_stack([x.ravel(), y.ravel(), np.ones(side_px**2)])
    fit = np.linalg.pinv(base)
    counts, rms, residuals = [], [], []
    for top in range(0, depth.shape[0] - side_px, side_px // 2):
        for left in range(0, depth.shape[1] - side_px, side_px // 2):
            tile = np.s_[top : top + side_px, left : left + side_px]
            z = depth[tile].ravel()
            if z.min() <= 0 or np.ptp(z) > _MOST_SPREAD_MM:
                continue
            residual = z - base @ (fit @ z)
            counts.append(float(np.median(infrared[tile])))
            rms.append(float(np.sqrt((residual**2).sum() / (side_px**2 - 3))))
            residuals.append(residual.reshape(side_px, side_px))
    shaped = np.array(residuals, np.float64).reshape(-1, side_px, side_px)
    return Tiles(np.array(counts, np.float64), np.array(rms, np.float64), shaped)
