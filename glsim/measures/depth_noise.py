"""Depth noise and its correlation, over time and in single frames, by distance and radius.

Over time: two frames of a static view differ by temporal noise only. Half the variance of the
difference is the variance of one frame. In a single frame: the residual of a quadric in 7 x 7
pixels holds temporal noise and fixed pattern. The quadric itself follows a part of the noise: 6/49
of white noise, more of correlated noise. Rounding to steps of q mm adds q^2 / 12 to the variance of
each frame, which is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from glsim.core.array_types import Array, Reals
from glsim.core.depth_frame import DepthFrame
from glsim.core.units import MM_PER_M
from glsim.measures.correlation import correlation_of, lagged_sums, without_local_mean
from glsim.measures.measured_frame import lit, radius_px, surface_mm, surfaces
from glsim.measures.quadrics import fit_surfaces
from glsim.measures.stacks import mean_of

#: Bounds of the cells' distances, m.
DISTANCES_M = (0.45, 0.65, 0.9, 1.2, 1.5, 2.0, 2.6, 3.2, 4.5)
RADII_PX = (0.0, 100.0, 160.0, 210.0, 250.0, 400.0)
#: Smallest number of pixels of a cell: sigma is then known to 5 %, even for correlated noise.
LEAST_PIXELS = 400


@dataclass(frozen=True)
class Cell:
    """A value for the pixels in a range of distances, m, and a range of radii, px."""

    distance_m: tuple[float, float]
    radius_px: tuple[float, float]
    value: float
    pixels: int


#: Arrays of one shape: pixels' distance, mm; radius, px; and value. NaN values do not count.
Sample = tuple[Reals, Reals, Reals]


def root_cells(samples: Sequence[Sample]) -> tuple[Cell, ...]:
    """Compute the root of the mean value in each cell with at least LEAST_PIXELS pixels."""
    if not samples:
        return ()
    depth, radius, value = (
        np.concatenate([np.asarray(s[k][np.isfinite(s[2])], np.float32) for s in samples])
        for k in range(3)
    )
    cells = []
    for near, far in pairwise(DISTANCES_M):
        row = (depth >= MM_PER_M * near) & (depth < MM_PER_M * far)
        for inner, outer in pairwise(RADII_PX):
            here = value[row & (radius >= inner) & (radius < outer)]
            if here.size >= LEAST_PIXELS:
                root = float(np.sqrt(max(float(here.mean(dtype=np.float64)), 0.0)))
                cells.append(Cell((near, far), (inner, outer), root, int(here.size)))
    return tuple(cells)


#: Outliers, such as edges and people, lie beyond _CLIP robust standard deviations of the pixels at
#: a similar distance, and beyond _LOCAL_CLIP of the 5 x 5 pixels around, since dark surfaces have
#: more noise. The values were chosen, not measured.
_CLIP, _LOCAL_CLIP = 5.0, 8.0
#: Width, mm, of the bins of distance in which drift is removed: drift depends on the distance.
_DRIFT_BIN_MM = 100.0


def pair_noise(first: DepthFrame, second: DepthFrame) -> Array:
    """Compute the temporal noise of one frame from two frames of one static view.

    It is their (H, W) difference, mm, over sqrt 2, without its mean (drift). Its variance is the
    variance of one frame, rounding included. It is NaN off smooth surfaces and for outliers.
    """
    noise = (second.measured_mm.astype(np.float64) - first.measured_mm) / np.sqrt(2.0)
    both = surfaces(first).smooth & surfaces(second).smooth
    noise = without_outliers(np.where(both, noise, np.nan), surface_mm(first))
    return np.asarray(noise - mean_of(noise))


def without_outliers(noise: Array, surface_mm: Reals) -> Array:
    """Replace outliers (edges, people) by NaN; pixels are compared at similar distances: (H, W)."""
    noise = noise.copy()
    both = np.isfinite(noise)
    size = np.abs(np.nan_to_num(noise)).astype(np.float32)
    around = _LOCAL_CLIP * 1.4826 * cv2.medianBlur(size, 5)
    for near, far in pairwise((0.0, *DISTANCES_M, 100.0)):
        here = both & (surface_mm >= MM_PER_M * near) & (surface_mm < MM_PER_M * far)
        if here.any():
            off = np.abs(noise[here] - np.median(noise[here]))
            limit = np.maximum(_CLIP * max(1.4826 * float(np.median(off)), 0.5), around[here])
            noise[here] = np.where(off <= limit, noise[here], np.nan)
    return noise


def still_difference(first: DepthFrame, second: DepthFrame) -> Array:
    """Subtract two frames of a still scene without drift: (H, W) mm; NaN: no depth, or moved.

    While ``pair_noise`` keeps smooth surfaces only, this keeps all pixels whose 3 x 3 neighbours
    have depth without a step in both frames. Its variance is the sum of both frames' variances.
    """
    whole = (fit_surfaces(f.measured_mm, f.rays, 3).rough_mm for f in (first, second))
    both = np.isfinite(sum(whole))
    difference = np.where(both, second.measured_mm.astype(np.float64) - first.measured_mm, np.nan)
    # The frames' mean does not correlate with their difference: its bins do not select noise.
    between_mm = 0.5 * (first.measured_mm + second.measured_mm)
    difference = without_outliers(difference, between_mm)
    # Motion changes whole regions alike; noise does not.
    middle = cv2.medianBlur(np.nan_to_num(difference).astype(np.float32), 5)
    known = np.isfinite(difference)
    if known.any():
        spread = 1.4826 * float(np.median(np.abs(difference[known])))
        difference[np.abs(middle) > _CLIP * max(spread, 0.5)] = np.nan
    known = np.isfinite(difference)
    place = (between_mm[known] / _DRIFT_BIN_MM).astype(int)
    drift = np.bincount(place, difference[known]) / np.maximum(np.bincount(place), 1)
    difference[known] -= drift[place]
    return difference


@dataclass(frozen=True)
class TemporalNoise:
    """Temporal noise of pairs of static frames: sigma in mm, less rounding; correlation at LAGS."""

    pairs: int
    cells: tuple[Cell, ...]
    correlation: tuple[float, ...]


def measure_temporal(
    frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]
) -> TemporalNoise:
    """Measure the temporal noise of static pairs of frame numbers."""
    samples: list[Sample] = []
    sums: list[Array] = []
    for first, second in pairs:
        a, b = frames[first], frames[second]
        noise = pair_noise(a, b)
        quantum = (a.step_mm**2 + b.step_mm**2) / 24.0
        samples.append((surface_mm(a), radius_px(a), noise**2 - quantum))
        sums.append(lagged_sums(without_local_mean(noise)))
    return TemporalNoise(len(pairs), root_cells(samples), correlation_of(sums))


#: Distance of the measured windows along both axes, px; nearer ones share most of their pixels.
_STRIDE = 3


@dataclass(frozen=True)
class SpatialNoise:
    """Residuals of local quadrics on all smooth surfaces.

    Attributes:
        cells: rms of the residual, mm, without rounding.
        rough_mm: 10th percentile, median and 90th percentile of the windows' rms, mm; NaN with
            fewer than 100 windows.
        correlation: correlation of the residual at LAGS, which is smaller than the noise's.
    """

    cells: tuple[Cell, ...]
    rough_mm: tuple[float, float, float]
    correlation: tuple[float, ...]


def measure_spatial(frames: Sequence[DepthFrame]) -> SpatialNoise:
    """Measure spatial noise: residuals of quadrics fitted around pixels of smooth surfaces."""
    samples, rough, sums = [], [], []
    for frame in frames:
        s = surfaces(frame)
        smooth = s.smooth & lit(frame)
        quantum = frame.step_mm**2 / 12.0
        squares = np.where(smooth, s.rough_mm.astype(np.float64) ** 2 - quantum, np.nan)
        every = np.s_[::_STRIDE, ::_STRIDE]
        samples.append((frame.measured_mm[every], radius_px(frame)[every], squares[every]))
        rough.append(np.sqrt(np.maximum(squares[every][smooth[every]], 0.0)))
        residual = np.where(smooth & (s.rough_mm < 6.0), s.residual_mm, np.nan)
        sums.append(lagged_sums(residual.astype(np.float64)))
    values = np.concatenate(rough)
    known = values if values.size >= 100 else np.full(1, np.nan)
    p10, median, p90 = np.percentile(known, (10, 50, 90)).tolist()
    return SpatialNoise(root_cells(samples), (p10, median, p90), correlation_of(sums))
