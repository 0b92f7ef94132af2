"""Measure noise statistics of a camera on a recording of a static scene. Depths in mm."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.errors import DatasetError
from glsim.fit.fixed_pattern import LAG_PX, FixedPattern, measure_pattern, second_difference
from glsim.fit.recording import Recording
from glsim.geometry.camera import Intrinsics

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A pixel is used if it has depth in at least this share of the frames.
_LEAST_VALID = 0.9
#: Neighbours whose depths differ by more than this form an edge (libfreenect2's filter: 100 mm).
EDGE_MM = 100.0
#: A flying pixel is farther than this from the surfaces on both sides of its edge.
FLYING_MM = 20.0
#: Bounds of the cells of the noise table: distances, m, and radii in pixels of a Kinect V2 (focal
#: length 365 px).
DISTANCES_M = (0.3, 0.7, 0.9, 1.1, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 8.0)
RADII_PX = (0.0, 100.0, 160.0, 210.0, 250.0, 1000.0)
_LEAST_PIXELS = 100
#: A flat, even surface: its second difference over 2 x 8 px, averaged over 5 x 5, is below this,
#: and its infrared in 9 x 9 varies by less than this share. Chosen so that an office scene of a
#: real Kinect V2 (0007, 0008) gives the rows and columns of a recording of a board.
_MOST_BEND_MM, _MOST_UNEVEN = 1.0, 0.08
_LEAST_FLAT_PX = 2000


@dataclass(frozen=True)
class NoiseCell:
    """Temporal noise of the pixels between two distances (m) and two radii (px)."""

    distance_m: tuple[float, float]
    radius_px: tuple[float, float]
    sigma_mm: float
    pixels: int


@dataclass(frozen=True, eq=False)
class RecordingStatistics:
    """Noise statistics of one recording.

    mean_mm, variance_mm2: (H, W) over time, NaN where depth is rare. smooth: (H, W), True where
    the surface is smooth and complete. table: temporal noise by distance and radius. correlation:
    that of the temporal noise at lags of 0 to 4 px along rows and columns. pattern: the fixed
    pattern. edge_pixels: number of pixels per frame beside depth edges; invalid_share,
    flying_share: the shares of them without depth and between the surfaces, NaN if there are none.
    """

    frames: int
    mean_mm: Array
    variance_mm2: Array
    smooth: Mask
    table: tuple[NoiseCell, ...]
    correlation: tuple[float, ...]
    pattern: FixedPattern
    edge_pixels: int
    invalid_share: float
    flying_share: float


def measure_recording(recording: Recording, image: Intrinsics) -> RecordingStatistics:
    """Measure all statistics. Raises DatasetError if no part of the scene is smooth enough."""
    depth = recording.depth
    count, mean, variance = _moments(recording)
    steady = count >= max(2.0, _LEAST_VALID * len(depth))
    smooth = _smooth_mask(np.where(steady, mean, np.nan))
    if smooth.sum() < _LEAST_PIXELS:
        raise DatasetError(
            f"{recording.where}: only {int(smooth.sum())} pixels belong to smooth surfaces with "
            "depth in nearly all frames: record walls, a floor, a table, and do not move"
        )
    noise = np.where(steady, variance / np.maximum(count, 1), 0.0)
    # Only well-lit pixels: the noise of far walls would hide the pattern.
    lit = smooth & (noise <= 2.0 * np.median(noise[smooth]))
    flat = lit & _flat_mask(recording, mean, steady)
    used = flat if flat.sum() >= _LEAST_FLAT_PX else lit
    pattern = measure_pattern(mean, _halves(recording), used)
    edge, invalid, flying = _edges(recording, mean, steady)
    return RecordingStatistics(
        frames=len(depth),
        mean_mm=np.where(steady, mean, np.nan),
        variance_mm2=np.where(steady, variance, np.nan),
        smooth=smooth,
        table=_noise_table(mean, variance, smooth, image),
        correlation=_correlation(recording, smooth),
        pattern=pattern,
        edge_pixels=edge,
        invalid_share=invalid,
        flying_share=flying,
    )


def _moments(recording: Recording) -> tuple[Array, Array, Array]:
    """Compute (H, W) counts of valid frames, their mean, mm, and unbiased variance, mm^2."""
    depth, unit = recording.depth, recording.unit_mm
    count = (depth > 0).sum(axis=0).astype(np.float64)
    mean = depth.sum(axis=0, dtype=np.float64) * unit / np.maximum(count, 1)
    squares = np.zeros(mean.shape)
    for frame in depth:
        squares += np.where(frame > 0, (frame * unit - mean) ** 2, 0.0)
    return count, mean, squares / np.maximum(count - 1, 1)


def _smooth_mask(mean: Array) -> Mask:
    """Find pixels whose 9 x 9 neighbourhood is complete and, except for noise, linear in depth."""
    bends = [second_difference(mean, axis, LAG_PX) for axis in (0, 1)]
    known = np.isfinite(bends[0]) & np.isfinite(bends[1])
    if not known.any():
        return known
    bend = np.where(known, np.maximum(np.abs(bends[0]), np.abs(bends[1])), np.inf)
    # The median bend is the noise of a wall; curved surfaces bend more than six times as much.
    limit = max(6.0 * float(np.median(bend[known])), 2.0)
    kernel = np.ones((2 * LAG_PX + 1,) * 2, np.uint8)
    flat = (bend < limit).astype(np.uint8)
    return np.asarray(cv2.erode(flat, kernel, borderValue=0) > 0)


def _flat_mask(recording: Recording, mean: Array, steady: Mask) -> Mask:
    """Find pixels around which the surface is flat and evenly bright: no cloth, seams or print.

    Depth is averaged over 5 x 5 first, which leaves little of the pattern to select by.
    """
    even = cv2.blur(np.where(steady, mean, 0.0), (5, 5))
    bends = [np.abs(second_difference(np.asarray(even), axis, 2 * LAG_PX)) for axis in (0, 1)]
    flat = (bends[0] < _MOST_BEND_MM) & (bends[1] < _MOST_BEND_MM)
    if recording.infrared is None:
        return np.asarray(flat)
    counts = recording.infrared.mean(axis=0)
    level = cv2.blur(counts, (9, 9))
    spread = np.sqrt(np.maximum(cv2.blur(counts**2, (9, 9)) - level**2, 0.0))
    return np.asarray(flat & (spread < _MOST_UNEVEN * level))


def _halves(recording: Recording) -> tuple[Array, Array]:
    """Average the even and the odd frames: two (H, W) means, mm, NaN where a half has no depth."""
    means = []
    for start in (0, 1):
        depth = recording.depth[start::2]
        count = (depth > 0).sum(axis=0)
        total = depth.sum(axis=0, dtype=np.float64) * recording.unit_mm
        means.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    return means[0], means[1]


def _noise_table(
    mean: Array, variance: Array, smooth: Mask, image: Intrinsics
) -> tuple[NoiseCell, ...]:
    """Average the temporal noise of smooth surfaces by distance and radius."""
    rays = image.rays().astype(np.float64)
    radius = np.hypot(rays[..., 0] * image.fx, rays[..., 1] * image.fy)
    cells = []
    for near, far in pairwise(DISTANCES_M):
        for inner, outer in pairwise(RADII_PX):
            scale = image.fx / 365.0
            here = smooth & (mean >= 1000 * near) & (mean < 1000 * far)
            here &= (radius >= inner * scale) & (radius < outer * scale)
            if here.sum() >= _LEAST_PIXELS:
                sigma = float(np.sqrt(variance[here].mean()))
                cells.append(NoiseCell((near, far), (inner, outer), sigma, int(here.sum())))
    return tuple(cells)


def _correlation(recording: Recording, smooth: Mask) -> tuple[float, ...]:
    """Compute the spatial correlation, lags 0 to 4 px, of differences of successive frames.

    These differences contain temporal noise only.
    """
    sums = np.zeros((5, 2))
    for before, after in zip(recording.depth[:-1], recording.depth[1:], strict=True):
        both = smooth & (before > 0) & (after > 0)
        noise = np.where(both, after.astype(np.float64) - before, 0.0)
        for lag in range(5):
            for axis in (0, 1):
                first, second = _shifted_pair(noise, axis, lag)
                first_valid, second_valid = _shifted_pair(both, axis, lag)
                sums[lag] += (first * second).sum(), (first_valid & second_valid).sum()
    product = sums[:, 0] / np.maximum(sums[:, 1], 1)
    if product[0] == 0:
        return (1.0, 0.0, 0.0, 0.0, 0.0)
    return tuple(float(p) for p in product / product[0])


def _shifted_pair(image: NDArray[np.generic], axis: int, lag: int) -> tuple[NDArray, NDArray]:  # type: ignore[type-arg]
    """Return an image without its last, and without its first, ``lag`` rows or columns."""
    moved = np.moveaxis(image, axis, 0)
    return moved[: len(moved) - lag], moved[lag:]


def _edges(recording: Recording, mean: Array, steady: Mask) -> tuple[int, float, float]:
    """Count pixels per frame beside depth edges; shares of those without depth and flying ones.

    An edge lies where steady pixels within 5 x 5 differ by more than EDGE_MM; the pixels beside it
    are at most one pixel away from the end of the nearer surface.
    """
    kernel = np.ones((5, 5), np.uint8)
    low = cv2.erode(np.where(steady, mean, 1e6), kernel, borderValue=1e6)
    high = cv2.dilate(np.where(steady, mean, 0.0), kernel, borderValue=0.0)
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    edge = (low < 1e6) & (high > 0) & (high - low > EDGE_MM)
    nearer = (steady & (mean < 0.5 * (low + high))).astype(np.uint8)
    beside = edge & (cv2.dilate(nearer, np.ones((3, 3), np.uint8)) > 0)
    beside &= cv2.erode(nearer, np.ones((3, 3), np.uint8)) == 0
    pixels = int(beside.sum())
    if pixels == 0:
        return 0, float("nan"), float("nan")
    values = recording.depth[:, beside] * recording.unit_mm
    valid = values > 0
    between = (values > low[beside] + FLYING_MM) & (values < high[beside] - FLYING_MM)
    return pixels, float((~valid).mean()), float((valid & between).mean())
