"""Noise over time: sigma by distance and radius, and its correlation between pixels.

Two frames are static if nothing moved between them: the difference of two such frames is
temporal noise only, and half its variance is that of one frame. Rounding to steps of q mm adds
q^2 / 12 to the variance of each frame, which is subtracted. Correlations are of the differences
from their mean in 31 x 31 pixels, so that a slow drift of a warming sensor does not count.
Method and cells as in design/reality.md, section 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.compare.frames import DepthFrame
from glsim.compare.surfaces import fit_surfaces
from glsim.validate.measure import mean_of, ratio

Array = NDArray[np.float64]

#: Bounds of the cells: distances, m, and radii, px of a Kinect V2.
DISTANCES_M = (0.45, 0.65, 0.9, 1.2, 1.5, 2.0, 2.6, 3.2, 4.5)
RADII_PX = (0.0, 100.0, 160.0, 210.0, 250.0, 400.0)
#: Pixels that a cell needs: its sigma is then known to 5 %, correlated noise included.
LEAST_PIXELS = 400
#: Lags of the correlation: (rows down, columns right).
LAGS = ((0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (3, 0), (1, 1))

#: A static pair differs by at most this much in the median, mm: three times the 1.2 mm that noise
#: of 1.3 mm gives. Two views of a room differ by centimetres.
_STATIC_MM = 4.0
#: Every eighth pixel along both axes decides whether a pair is static.
_THINNING = 8
#: Share of the pixels with depth in both frames that a static pair needs.
_LEAST_SHARED = 0.2
#: Above this number of frames only neighbours in time are compared.
_ALL_PAIRS_BELOW = 80
#: Differences beyond five robust standard deviations of their distance, and beyond eight of the 5x5
#: pixels around (dark surfaces have more noise), are edges and people, not noise.
_CLIP, _LOCAL_CLIP = 5.0, 8.0
#: The mean difference of a static pair is removed in bins of this width, mm: while a sensor warms
#: up, its distances drift by up to 2 mm, by another amount at every distance (two frames of IA).
_DRIFT_BIN_MM = 100.0


def static_pairs(frames: Sequence[DepthFrame]) -> list[tuple[int, int]]:
    """Find static pairs: (first, second) numbers of frames, each frame with the next static one."""
    thin = [f.depth_mm[::_THINNING, ::_THINNING] for f in frames]
    pairs = []
    for first in range(len(frames)):
        last = len(frames) if len(frames) <= _ALL_PAIRS_BELOW else min(first + 2, len(frames))
        for second in range(first + 1, last):
            difference = np.abs(thin[first] - thin[second])
            known = np.isfinite(difference)
            if known.mean() >= _LEAST_SHARED and np.median(difference[known]) <= _STATIC_MM:
                pairs.append((first, second))
                break
    return pairs


def pair_noise(first: DepthFrame, second: DepthFrame) -> Array:
    """Return (H, W) temporal noise of a pair: difference over sqrt 2, mm, NaN off surfaces.

    Its variance is that of one frame, rounding included. Pixels are of smooth surfaces in both
    frames; outliers are dropped, and the mean of all is subtracted (a sensor that warms up drifts).
    """
    noise = (second.depth_mm.astype(np.float64) - first.depth_mm) / np.sqrt(2.0)
    # Cells by the depth of the surface: by that of a noisy pixel, the pixels of a cell that are at
    # its bounds would all have noise of one sign.
    surface_mm = first.depth_mm - first.surfaces.residual_mm
    both = first.surfaces.smooth & second.surfaces.smooth
    noise = without_outliers(np.where(both, noise, np.nan), surface_mm)
    return np.asarray(noise - mean_of(noise))


def without_outliers(noise: Array, surface_mm: NDArray[np.floating]) -> Array:
    """Return (H, W) noise with NaN for edges and people; surface_mm: distance of the surfaces."""
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
    """Return (H, W) second - first without drift, mm; NaN where either has no depth or moved.

    Unlike ``pair_noise`` it holds all pixels whose 3 x 3 neighbours have depth without a step in
    both frames: rough surfaces, corners and the vicinity of edges too. Its variance is the sum of
    the variances of both frames.
    """
    whole = (fit_surfaces(f.depth_mm, f.rays, 3).rough_mm for f in (first, second))
    both = np.isfinite(sum(whole))
    difference = np.where(both, second.depth_mm.astype(np.float64) - first.depth_mm, np.nan)
    # The mean of both frames does not correlate with their difference: bins keep all of its noise.
    surface_mm = 0.5 * (first.depth_mm + second.depth_mm)
    difference = without_outliers(difference, surface_mm)
    # What moved differs by the same amount over a whole region, noise does not.
    middle = cv2.medianBlur(np.nan_to_num(difference).astype(np.float32), 5)
    known = np.isfinite(difference)
    if known.any():
        spread = 1.4826 * float(np.median(np.abs(difference[known])))
        difference[np.abs(middle) > _CLIP * max(spread, 0.5)] = np.nan
    known = np.isfinite(difference)
    place = (surface_mm[known] / _DRIFT_BIN_MM).astype(int)
    sums = np.bincount(place, difference[known])
    drift = sums / np.maximum(np.bincount(place), 1)
    difference[known] -= drift[place]
    return difference


@dataclass(frozen=True)
class Cell:
    """A value of the pixels between two distances (m) and two radii (px)."""

    distance_m: tuple[float, float]
    radius_px: tuple[float, float]
    value: float
    pixels: int


@dataclass(frozen=True)
class TemporalNoise:
    """pairs: static pairs. cells: sigma_T, mm. correlation: (len(LAGS),), NaN without pairs."""

    pairs: int
    cells: tuple[Cell, ...]
    correlation: tuple[float, ...]


def measure_temporal(
    frames: Sequence[DepthFrame], pairs: Sequence[tuple[int, int]]
) -> TemporalNoise:
    """Measure sigma_T by distance and radius, and the correlation at LAGS; quantisation removed."""
    samples = Samples()
    products: list[Array] = []
    for first, second in pairs:
        a, b = frames[first], frames[second]
        noise = pair_noise(a, b)
        quantum = (a.quantum_mm**2 + b.quantum_mm**2) / 24.0
        surface_mm = a.depth_mm - a.surfaces.residual_mm
        samples.add(surface_mm, a.radius_px, noise**2 - quantum)
        products.append(lagged_products(without_local_mean(noise)))
    return TemporalNoise(len(pairs), samples.root_cells(), correlation_of(products))


class Samples:
    """Pixels of several frames: distance (mm), radius (px) and a value each."""

    def __init__(self) -> None:
        self._parts: list[tuple[NDArray[np.float32], ...]] = []

    def add(
        self,
        depth_mm: NDArray[np.floating],
        radius_px: NDArray[np.floating],
        value: NDArray[np.floating],
    ) -> None:
        """Add the pixels whose value is finite."""
        known = np.isfinite(value)
        parts = (depth_mm[known], radius_px[known], value[known])
        self._parts.append(tuple(np.asarray(p, np.float32) for p in parts))

    def root_cells(self) -> tuple[Cell, ...]:
        """Return the root of the mean value in each cell of DISTANCES_M and RADII_PX."""
        if not self._parts:
            return ()
        depth, radius, value = (np.concatenate(p) for p in zip(*self._parts, strict=True))
        cells = []
        for near, far in pairwise(DISTANCES_M):
            row = (depth >= 1000 * near) & (depth < 1000 * far)
            for inner, outer in pairwise(RADII_PX):
                here = value[row & (radius >= inner) & (radius < outer)]
                if here.size >= LEAST_PIXELS:
                    root = float(np.sqrt(max(float(here.mean(dtype=np.float64)), 0.0)))
                    cells.append(Cell((near, far), (inner, outer), root, int(here.size)))
        return tuple(cells)


def without_local_mean(noise: Array, size: int = 31) -> Array:
    """Subtract the mean of the known pixels in size x size; NaN stays NaN."""
    known = np.isfinite(noise)
    total, count = (
        cv2.boxFilter(
            image, cv2.CV_64F, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        for image in (np.where(known, noise, 0.0), known.astype(np.float64))
    )
    return np.where(known, noise - total / np.maximum(count, 1.0), np.nan)


def lagged_products(noise: Array) -> Array:
    """Return (1 + len(LAGS), 2) sums of products and of squares at lag 0 and at LAGS.

    The squares are of the pixels that have a partner at that lag. Two diagonals are averaged.
    """
    rows = [(float(np.nansum(noise**2)),) * 2]
    for down, right in LAGS:
        ways = [(down, right)] if 0 in (down, right) else [(down, right), (down, -right)]
        sums = np.zeros(2)
        for way in ways:
            a, b = _shifted(noise, *way)
            both = np.isfinite(a) & np.isfinite(b)
            sums += (a[both] * b[both]).sum(), 0.5 * (a[both] ** 2 + b[both] ** 2).sum()
        rows.append((float(sums[0]), float(sums[1])))
    return np.array(rows)


def _shifted(image: Array, down: int, right: int) -> tuple[Array, Array]:
    height, width = image.shape
    first = image[: height - down, max(0, -right) : width - max(0, right)]
    return first, image[down:, max(0, right) : width + min(0, right)]


def correlation_of(products: Sequence[Array]) -> tuple[float, ...]:
    """Return the correlation at LAGS of the sums of several images; NaN if there are none."""
    if not products:
        return (float("nan"),) * len(LAGS)
    total = np.sum(products, axis=0)
    return tuple(ratio(float(p), float(s)) for p, s in total[1:])


def overall(cells: Sequence[Cell], near_m: float, far_m: float, most_px: float = 160.0) -> float:
    """Average a table over the cells between two distances and within a radius; NaN if none."""
    chosen = [
        cell.value
        for cell in cells
        if cell.distance_m[0] >= near_m - 1e-6
        and cell.distance_m[1] <= far_m + 1e-6
        and cell.radius_px[1] <= most_px
    ]
    return mean_of(np.array(chosen))
