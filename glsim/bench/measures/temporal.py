"""Noise over time: sigma by distance and radius, and its correlation between pixels.

The difference of two frames of one view is temporal noise only; half its variance is that of one
frame. Rounding to steps of q mm adds q^2 / 12 to the variance of each frame, which is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.cells import DISTANCES_M, Cell, Samples
from glsim.bench.measures.correlation import correlation_of, lagged_sums, without_local_mean
from glsim.bench.measures.frame import radius_px, surface_mm, surfaces
from glsim.bench.measures.stacks import mean_of
from glsim.bench.measures.surfaces import fit_surfaces
from glsim.core.depth_frame import DepthFrame

Array = NDArray[np.float64]

#: Outliers (edges, people): beyond _CLIP robust standard deviations of pixels of like distance, and
#: _LOCAL_CLIP of the 5 x 5 pixels around (dark surfaces have more noise).
_CLIP, _LOCAL_CLIP = 5.0, 8.0
#: Width of the bins in which drift is removed, mm: it differs from distance to distance.
_DRIFT_BIN_MM = 100.0


def pair_noise(first: DepthFrame, second: DepthFrame) -> Array:
    """Compute the temporal noise of one frame from a static pair.

    Args:
        first: a frame.
        second: a frame of the same view.

    Returns:
        (H, W) difference over sqrt 2, mm, without its mean (drift); its variance is that of one
        frame, rounding included. NaN off smooth surfaces and for outliers.

    """
    noise = (second.measured_mm.astype(np.float64) - first.measured_mm) / np.sqrt(2.0)
    both = surfaces(first).smooth & surfaces(second).smooth
    noise = without_outliers(np.where(both, noise, np.nan), surface_mm(first))
    return np.asarray(noise - mean_of(noise))


def without_outliers(noise: Array, surface_mm: NDArray[np.floating]) -> Array:
    """Return (H, W) noise with NaN for outliers (edges, people) among pixels of like distance."""
    noise = noise.copy()
    both = np.isfinite(noise)
    size = np.abs(np.nan_to_num(noise)).astype(np.float32)
    around = _LOCAL_CLIP * 1.4826 * cv2.medianBlur(size, 5)
    for near, far in pairwise((0.0, *DISTANCES_M, 100.0)):
        here = both & (surface_mm >= 1000 * near) & (surface_mm < 1000 * far)
        if here.any():
            off = np.abs(noise[here] - np.median(noise[here]))
            spread = 1.4826 * float(np.median(off))
            limit = np.maximum(_CLIP * max(spread, 0.5), around[here])
            noise[here] = np.where(off <= limit, noise[here], np.nan)
    return noise


def still_difference(first: DepthFrame, second: DepthFrame) -> Array:
    """Return (H, W) second - first without drift, mm; NaN where depth is missing or has moved.

    ``pair_noise`` keeps smooth surfaces alone; this keeps all pixels whose 3 x 3 neighbours have
    depth without a step in both frames. Its variance is the sum of the variances of both frames.
    """
    whole = (fit_surfaces(f.measured_mm, f.rays, 3).rough_mm for f in (first, second))
    both = np.isfinite(sum(whole))
    difference = np.where(both, second.measured_mm.astype(np.float64) - first.measured_mm, np.nan)
    # The mean of both frames does not correlate with their difference: bins keep all of its noise.
    between_mm = 0.5 * (first.measured_mm + second.measured_mm)
    difference = without_outliers(difference, between_mm)
    # Motion changes a whole region alike, noise does not.
    middle = cv2.medianBlur(np.nan_to_num(difference).astype(np.float32), 5)
    known = np.isfinite(difference)
    if known.any():
        spread = 1.4826 * float(np.median(np.abs(difference[known])))
        difference[np.abs(middle) > _CLIP * max(spread, 0.5)] = np.nan
    known = np.isfinite(difference)
    place = (between_mm[known] / _DRIFT_BIN_MM).astype(int)
    sums = np.bincount(place, difference[known])
    drift = sums / np.maximum(np.bincount(place), 1)
    difference[known] -= drift[place]
    return difference


@dataclass(frozen=True)
class TemporalNoise:
    """Temporal noise of a set.

    Attributes:
        pairs: number of static pairs.
        cells: sigma_T, mm, rounding subtracted.
        correlation: between pixels at LAGS; NaN without pairs.

    """

    pairs: int
    cells: tuple[Cell, ...]
    correlation: tuple[float, ...]


def measure_temporal(
    frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]
) -> TemporalNoise:
    """Measure the temporal noise of static pairs, given by the numbers of their frames."""
    samples = Samples()
    sums: list[Array] = []
    for first, second in pairs:
        a, b = frames[first], frames[second]
        noise = pair_noise(a, b)
        quantum = (a.step_mm**2 + b.step_mm**2) / 24.0
        samples.add(surface_mm(a), radius_px(a), noise**2 - quantum)
        sums.append(lagged_sums(without_local_mean(noise)))
    return TemporalNoise(len(pairs), samples.root_cells(), correlation_of(sums))
