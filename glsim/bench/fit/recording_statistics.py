"""Noise statistics of a camera on a recording of a static scene, for the fit of a sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Mask
from glsim.core.depth_frame import DepthFrame, Frames
from glsim.core.errors import DatasetError, counted
from glsim.core.units import MM_PER_M
from glsim.measures.measured_frame import mean_frame
from glsim.measures.pattern import measure_pattern
from glsim.measures.quadrics import local_planes
from glsim.measures.stacks import mean_of, moments
from glsim.sensors.images import LARGEST_MM

#: A pattern map is depth minus the best plane of a window: side of the window, px, and smallest
#: share of usable pixels in it. Chosen: smoother errors look like the scene's shape.
MAP_WINDOW_PX, _LEAST_WINDOW = 15, 0.2


def pattern_parameters(halves: Sequence[DepthFrame]) -> dict[str, float]:
    """Measure the fixed pattern of a device by the function of ``glsim compare``.

    The halves are the means of the even and of the odd frames. Returns parameters of the stage
    ``fixed_pattern``, mm, 0 where the frames are too few or too small to show one. The stage draws
    the alternation's sign at random.
    """
    measured = measure_pattern(halves)
    bands = np.array(measured.alternation_mm)  # half steps of odd rows, from the top to the bottom
    upper, lower = (float(np.nan_to_num(mean_of(part))) for part in np.array_split(bands, 2))
    rows_mm2 = measured.rows_mm**2 - measured.alternation_rms_mm**2
    parameters = {
        "column_sigma_mm": measured.columns_mm,
        "row_sigma_mm": np.sqrt(np.fmax(rows_mm2, 0.0)),
        "row_alternation_mm": 0.5 * abs(lower - upper),
        "row_step_mm": upper + lower,
        "pixel_sigma_mm": measured.rest_mm,
    }
    return {name: float(np.nan_to_num(value)) for name, value in parameters.items()}


def pattern_map(mean_mm: Array, used: Mask) -> NDArray[np.float32]:
    """Compute the (H, W) depth minus the best plane in windows of MAP_WINDOW_PX, mm.

    NaN where a window has too few usable pixels, or a value above LARGEST_MM (no pattern).
    """
    if not used.any():
        return np.full(used.shape, np.nan, np.float32)
    inverse = np.where(used, MM_PER_M / np.where(used, mean_mm, 1.0), 0.0)  # linear on a plane
    plane, _, share = local_planes(inverse, used, np.ones(MAP_WINDOW_PX))
    enough = used & (share >= _LEAST_WINDOW)
    residual = (plane - inverse) * mean_mm**2 / MM_PER_M
    enough &= np.abs(residual) <= LARGEST_MM
    return np.where(enough, residual, np.nan).astype(np.float32)


#: A pixel is measured if it has depth, and rests, in at least this share of the frames. Chosen.
_LEAST_VALID = 0.5
#: Lag of second differences, px. Two 3 x 3 filters do not reach that far, and the lag is even, so
#: that an alternation of rows cancels.
_LAG_PX = 4
_LEAST_PIXELS = 100
#: Limits for flat, evenly bright surfaces: second difference over 2 x 8 px, mm, and relative
#: variation of infrared in 9 x 9 px. Chosen: recordings of an office and of a board then give the
#: same errors of rows and columns.
_MOST_BEND_MM, _MOST_UNEVEN = 1.0, 0.08
_LEAST_FLAT_PX = 2000


@dataclass(frozen=True, eq=False)
class RecordingStatistics:
    """Noise statistics of one recording.

    Attributes:
        mean_mm: (H, W) mean over time; NaN where too few frames have depth.
        variance_mm2: (H, W) variance over time; NaN where too few frames have depth.
        smooth: (H, W) mask of smooth surfaces without holes.
        pattern: parameters of the stage ``fixed_pattern``, mm.
        map_mm: (H, W) float32 pattern, NaN where the scene is not smooth.
    """

    frames: int
    mean_mm: Array
    variance_mm2: Array
    smooth: Mask
    pattern: Mapping[str, float]
    map_mm: NDArray[np.float32]


def measure_recording(frames: Frames) -> RecordingStatistics:
    """Measure a static recording. Raises DatasetError if no surface is smooth enough."""
    count, mean, variance = moments([frame.measured_mm for frame in frames])
    steady = count >= max(2.0, _LEAST_VALID * len(frames))
    smooth = _smooth_mask(np.where(steady, mean, np.nan))
    if smooth.sum() < _LEAST_PIXELS:
        raise DatasetError(
            f"{frames.title}: only {counted(int(smooth.sum()), 'pixel')} on smooth surfaces with "
            "depth in nearly all frames: record walls, a floor, a table, and do not move"
        )
    noise = np.where(steady, variance / np.maximum(count, 1), 0.0)
    # Use well-lit pixels only: on far walls, noise would hide the pattern.
    lit = smooth & (noise <= 2.0 * np.median(noise[smooth]))
    whole = mean_frame(frames)
    flat = lit & _flat_mask(whole.infrared, mean, steady)
    used = flat if flat.sum() >= _LEAST_FLAT_PX else lit
    pattern = pattern_parameters([mean_frame(frames[start::2]) for start in (0, 1)])
    return RecordingStatistics(
        frames=len(frames), mean_mm=np.where(steady, mean, np.nan),
        variance_mm2=np.where(steady, variance, np.nan), smooth=smooth, pattern=pattern,
        map_mm=pattern_map(mean, used),
    )  # fmt: skip


def _smooth_mask(mean: Array) -> Mask:
    """Find pixels whose 9 x 9 window has no holes and is a plane, except for noise."""
    bend = _bend(mean, _LAG_PX)
    known = np.isfinite(bend)
    if not known.any():
        return known
    # The median second difference is a wall's noise; curved surfaces have six times more.
    limit = max(6.0 * float(np.median(bend[known])), 2.0)
    kernel = np.ones((2 * _LAG_PX + 1,) * 2, np.uint8)
    flat = (bend < limit).astype(np.uint8)
    return np.asarray(cv2.erode(flat, kernel, borderValue=0) > 0)


def _flat_mask(infrared: NDArray[np.float32] | None, mean: Array, steady: Mask) -> Mask:
    """Find pixels on flat, evenly bright surfaces, without cloth, seams and print."""
    even = np.asarray(cv2.blur(np.where(steady, mean, 0.0), (5, 5)), np.float64)
    flat = _bend(even, 2 * _LAG_PX) < _MOST_BEND_MM
    if infrared is None:
        return np.asarray(flat)
    counts = infrared.astype(np.float64)
    level = cv2.blur(counts, (9, 9))
    spread = np.sqrt(np.maximum(cv2.blur(counts**2, (9, 9)) - level**2, 0.0))
    return np.asarray(flat & (spread < _MOST_UNEVEN * level))


def _bend(image: Array, lag: int) -> Array:
    """Compute the largest |image[i - lag] - 2 image[i] + image[i + lag]| over both axes, or NaN."""
    down, across = (np.full(image.shape, np.nan) for _ in range(2))
    down[lag:-lag] = image[: -2 * lag] - 2 * image[lag:-lag] + image[2 * lag :]
    across[:, lag:-lag] = image[:, : -2 * lag] - 2 * image[:, lag:-lag] + image[:, 2 * lag :]
    return np.asarray(np.maximum(np.abs(down), np.abs(across)))
