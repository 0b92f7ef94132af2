"""Measure noise statistics of a camera on a recording of a static scene. Depths in mm."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.compare.frames import DepthFrame
from glsim.compare.temporal import (
    Cell,
    Samples,
    correlation_of,
    lagged_products,
    without_local_mean,
)
from glsim.errors import DatasetError
from glsim.fit.fixed_pattern import FixedPattern, describe_pattern
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
#: Distance of the pixels in a difference: beyond the reach of two 3 x 3 filters, and even, so that
#: an alternation of rows cancels.
LAG_PX = 4
_LEAST_PIXELS = 100
#: A flat, even surface: its second difference over 2 x 8 px, averaged over 5 x 5, is below this,
#: and its infrared in 9 x 9 varies by less than this share. Chosen so that an office scene of a
#: real Kinect V2 (0007, 0008) gives the rows and columns of a recording of a board.
_MOST_BEND_MM, _MOST_UNEVEN = 1.0, 0.08
_LEAST_FLAT_PX = 2000


@dataclass(frozen=True, eq=False)
class RecordingStatistics:
    """Noise statistics of one recording.

    mean_mm, variance_mm2: (H, W) over time, NaN where depth is rare. smooth: (H, W), True where
    the surface is smooth and complete. table: temporal noise by distance and radius, rounding
    removed. correlation: (len(LAGS),), that of the temporal noise at compare's LAGS. pattern: the
    fixed pattern. edge_pixels: number of pixels per frame beside depth edges; invalid_share,
    flying_share: the shares of them without depth and between the surfaces, NaN if there are none.
    """

    frames: int
    mean_mm: Array
    variance_mm2: Array
    smooth: Mask
    table: tuple[Cell, ...]
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
    halves = [average(recording, image, slice(start, None, 2)) for start in (0, 1)]
    pattern = describe_pattern(halves, mean, used)
    edge, invalid, flying = _edges(recording, mean, steady)
    return RecordingStatistics(
        frames=len(depth),
        mean_mm=np.where(steady, mean, np.nan),
        variance_mm2=np.where(steady, variance, np.nan),
        smooth=smooth,
        table=_noise_table(recording, mean, variance, smooth, image),
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


def average(recording: Recording, image: Intrinsics, frames: slice = slice(None)) -> DepthFrame:
    """Return the mean of frames as a DepthFrame, mm; NaN where no frame has depth."""
    depth = recording.depth[frames]
    count = (depth > 0).sum(axis=0)
    total = depth.sum(axis=0, dtype=np.float64) * recording.unit_mm
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan).astype(np.float32)
    light = None
    if recording.infrared is not None:
        light = recording.infrared[frames].mean(axis=0).astype(np.float32)
    return DepthFrame("mean", mean, light, image, recording.unit_mm / len(depth) ** 0.5)


def single_frame(recording: Recording, image: Intrinsics, number: int) -> DepthFrame:
    """Return one frame of a recording."""
    return average(recording, image, slice(number, number + 1))


def _noise_table(
    recording: Recording, mean: Array, variance: Array, smooth: Mask, image: Intrinsics
) -> tuple[Cell, ...]:
    """Average the temporal noise of smooth surfaces in compare's cells."""
    samples = Samples()
    radius = average(recording, image).radius_px
    samples.add(mean, radius, np.where(smooth, variance - recording.unit_mm**2 / 12.0, np.nan))
    return samples.root_cells()


def _correlation(recording: Recording, smooth: Mask) -> tuple[float, ...]:
    """Correlate the differences of successive frames, which hold temporal noise only."""
    products = []
    for before, after in zip(recording.depth[:-1], recording.depth[1:], strict=True):
        both = smooth & (before > 0) & (after > 0)
        noise = np.where(both, after.astype(np.float64) - before, np.nan)
        products.append(lagged_products(without_local_mean(noise)))
    return correlation_of(products)


def second_difference(image: Array, axis: int, lag: int) -> Array:
    """Compute image[i - lag] - 2 image[i] + image[i + lag]; NaN at the border."""
    moved = np.moveaxis(image, axis, 0)
    out = np.full(moved.shape, np.nan)
    out[lag:-lag] = moved[: -2 * lag] - 2 * moved[lag:-lag] + moved[2 * lag :]
    return np.moveaxis(out, 0, axis)


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
