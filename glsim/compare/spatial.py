"""Noise of single frames: what a quadric in 7 x 7 pixels leaves, by distance and radius.

It holds temporal noise and the fixed pattern, less what the quadric follows: a part of white noise
of 6/49, more of correlated noise. Both sets of a comparison lose the same part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.compare.frames import DepthFrame
from glsim.compare.temporal import Cell, Samples, correlation_of, lagged_products

#: Windows that are measured: every third along both axes; nearer ones share most of their pixels.
_STRIDE = 3


@dataclass(frozen=True)
class SpatialNoise:
    """Residuals of all smooth surfaces, planes or not.

    cells: rms by distance and radius, mm. rough_mm: (p10, median, p90) of the residual of a window,
    NaN with fewer than 100 windows. correlation: of the residual at LAGS; the quadric makes it
    smaller than that of the noise.
    """

    cells: tuple[Cell, ...]
    rough_mm: tuple[float, float, float]
    correlation: tuple[float, ...]


def measure_spatial(frames: Sequence[DepthFrame]) -> SpatialNoise:
    """Measure the residuals of all smooth surfaces; quantisation is removed from the variances."""
    samples, rough, products = Samples(), [], []
    for frame in frames:
        s = frame.surfaces
        smooth = s.smooth & frame.lit
        quantum = frame.quantum_mm**2 / 12.0
        squares = np.where(smooth, s.rough_mm.astype(np.float64) ** 2 - quantum, np.nan)
        every = np.s_[::_STRIDE, ::_STRIDE]
        samples.add(frame.depth_mm[every], frame.radius_px[every], squares[every])
        rough.append(np.sqrt(np.maximum(squares[every][smooth[every]], 0.0)))
        residual = np.where(smooth & (s.rough_mm < 6.0), s.residual_mm, np.nan)
        products.append(lagged_products(residual.astype(np.float64)))
    return SpatialNoise(samples.root_cells(), _percentiles(rough), correlation_of(products))


def _percentiles(parts: Sequence[np.ndarray]) -> tuple[float, float, float]:
    values = np.concatenate(parts)
    if values.size < 100:
        return (float("nan"),) * 3
    p10, median, p90 = np.percentile(values, (10, 50, 90))
    return float(p10), float(median), float(p90)
