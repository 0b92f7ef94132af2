"""Noise of single frames: the residual of a quadric in 7 x 7 pixels, by distance and radius.

It holds temporal noise and fixed pattern, less what the quadric follows: 6/49 of white noise, more
of correlated noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.bench.measures.cells import Cell, Samples
from glsim.bench.measures.correlation import correlation_of, lagged_sums
from glsim.bench.measures.frame import lit, radius_px, surfaces
from glsim.core.depth_frame import DepthFrame

#: Windows that are measured: every third along both axes; nearer ones share most of their pixels.
_STRIDE = 3


@dataclass(frozen=True)
class SpatialNoise:
    """Residuals of all smooth surfaces.

    Attributes:
        cells: rms, mm, rounding subtracted.
        rough_mm: 10th percentile, median and 90th of the rms in a window, mm; NaN with fewer than
            100 windows.
        correlation: of the residual at LAGS, smaller than that of the noise.

    """

    cells: tuple[Cell, ...]
    rough_mm: tuple[float, float, float]
    correlation: tuple[float, ...]


def measure_spatial(frames: Sequence[DepthFrame]) -> SpatialNoise:
    """Measure the residuals of all smooth surfaces."""
    samples, rough, sums = Samples(), [], []
    for frame in frames:
        s = surfaces(frame)
        smooth = s.smooth & lit(frame)
        quantum = frame.step_mm**2 / 12.0
        squares = np.where(smooth, s.rough_mm.astype(np.float64) ** 2 - quantum, np.nan)
        every = np.s_[::_STRIDE, ::_STRIDE]
        samples.add(frame.measured_mm[every], radius_px(frame)[every], squares[every])
        rough.append(np.sqrt(np.maximum(squares[every][smooth[every]], 0.0)))
        residual = np.where(smooth & (s.rough_mm < 6.0), s.residual_mm, np.nan)
        sums.append(lagged_sums(residual.astype(np.float64)))
    return SpatialNoise(samples.root_cells(), _percentiles(rough), correlation_of(sums))


def _percentiles(parts: Sequence[np.ndarray]) -> tuple[float, float, float]:
    values = np.concatenate(parts)
    if values.size < 100:
        return (float("nan"),) * 3
    p10, median, p90 = np.percentile(values, (10, 50, 90))
    return float(p10), float(median), float(p90)
