"""Safeguards keep noiseless frames, and reject guesses between two surfaces or far from depth."""

from __future__ import annotations

import math
from typing import Any, Final

import cv2
import numpy as np

from glsim.core.array_types import Array, Depth, Mask
from glsim.core.depth_map import JUMP_MM

#: A frame in whole millimetres is clean, and is returned unchanged, if its noise between adjacent
#: and between every other pixel is below these bounds, mm. Measured: 656 simulated frames without
#: noise at most 0.312 and 0.551; 500 with white noise at least 0.354; 96 with smooth noise at least
#: 0.29 and 0.559. Finer steps: bounds in steps.
CLEAN_MM: Final = (0.33, 0.56)
#: A frame of finer steps above these bounds is clean, too, if only form causes its estimate, which
#: grows faster with the distance of the compared pixels than noise does: between every fourth pixel
#: it must be at least this multiple of that between adjacent ones (without rounding); pairs of
#: (largest step in mm, multiple). Measured on 144 heads each without noise at 0.25 to 2 m: at least
#: 7.2 unrounded, 5.6 in steps of 0.1 mm, 3.84 in steps of 0.2 mm; TrueDepth: boards at most 3.5.
FORM_GROWTH: Final = ((0.1, 5.2), (1.0, 3.8))
#: A frame in whole millimetres below the bounds CLEAN_MM is noisy if noise smaller than a step
#: moves single pixels by a step: of all pixels between two equal depths, in a row or column, N have
#: another. On clean surfaces these are ridges and valleys, and N grows with the side of the image,
#: under noise with its area. A frame is dithered if N / S and N / S times the share of such pixels
#: exceed these bounds; S is the root of the number of measured pixels. Measured: N / S of 254 clean
#: maps at most 2.0, strands of hair 3.1; of 41 noisy ones of azure-kinect and truedepth at least
#: 3.6 and 0.35. Folds and hair of dressed people pass for dither: up to 5.1 and 1.2 from 0.9 m on.
DITHER_SIDE, DITHER_DENSITY = 3.3, 0.3
#: The test for dither applies to maps with at least this step, mm.
DITHER_LEAST_MM: Final = 0.9
#: Largest difference of a pixel that dither moves, steps. Chosen: more is relief or an edge.
DITHER_STEPS: Final = 2.5
#: Depths that differ by less than this, mm, are equal: float32 resolves 0.0005 mm at 4 m.
SAME_MM: Final = 5e-4
#: Largest accepted risk (predicted error of the chosen surface), mm, at measured pixels and in
#: holes. Chosen by the RMSE of the shipped network under each sensor, with and without a wall.
MEASURED_RISK_MM, HOLE_RISK_MM = 40.0, 10.0
#: Largest distance from a measured pixel at which training asks for depth (loss.reach_px).
REACH_PX: Final = 12

#: Second differences of rows and columns: 0 on planes, standard deviation 6 for white noise of 1
#: (Immerkaer, "Fast Noise Variance Estimation", CVIU 1996).
_KERNEL: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
GAIN: Final = 6.0
#: Mean of the square root of |x| for a standard normal x, 2^(1/4) Gamma(3/4) / sqrt(pi). Averaging
#: roots limits the influence of the large values at facial features.
MEAN_ROOT: Final = 2**0.25 * math.gamma(0.75) / math.sqrt(math.pi)
#: Smallest number of windows without an edge for an estimate of noise.
LEAST_WINDOWS: Final = 50
#: Smallest local noise, mm, since rounded windows may have no difference.
_LEAST_MM: Final = 0.01
_LOCAL_PX: Final = (15, 15)


def clean_noise_mm(depth_mm: Depth) -> float | None:
    """Return a map's noise, mm, if its own rounding and surface form explain it; else None."""
    near_mm, far_mm = (estimate_noise_mm(depth_mm, step) for step in (1, 2))
    if near_mm is None or far_mm is None or near_mm >= CLEAN_MM[0] or far_mm >= CLEAN_MM[1]:
        return None
    step_mm = value_step_mm(depth_mm)
    if is_dithered(depth_mm, step_mm):
        return None
    if near_mm < CLEAN_MM[0] * step_mm and far_mm < CLEAN_MM[1] * step_mm:
        return near_mm
    farther_mm = estimate_noise_mm(depth_mm, 4)
    if farther_mm is None:
        return near_mm
    rounding_mm2 = step_mm**2 / 12
    least = next(ratio for most_mm, ratio in FORM_GROWTH if step_mm <= most_mm + SAME_MM)
    grown = farther_mm**2 - rounding_mm2 >= least**2 * (near_mm**2 - rounding_mm2)
    return near_mm if grown else None


def value_step_mm(depth_mm: Depth) -> float:
    """Return the smallest step between a map's depths, mm, at most 1; near 0 if unrounded."""
    gaps_mm = np.diff(np.unique(depth_mm[depth_mm > 0]))
    return float(gaps_mm.min(initial=1.0, where=gaps_mm > SAME_MM))


def is_dithered(depth_mm: Depth, step_mm: float) -> bool:
    """Return whether noise moves pixels between steps of whole mm; False for finer steps."""
    if step_mm < DITHER_LEAST_MM:
        return False
    places = dithered = 0
    for image in (depth_mm, depth_mm.T):
        before, middle, after = image[:, :-2], image[:, 1:-1], image[:, 2:]
        apart_mm = np.abs(middle - before)
        level = (before == after) & (before > 0) & (middle > 0)
        level &= apart_mm < DITHER_STEPS * step_mm
        places += int(np.count_nonzero(level))
        dithered += int(np.count_nonzero(level & (apart_mm > SAME_MM)))
    side = math.sqrt(np.count_nonzero(depth_mm))
    return dithered > DITHER_SIDE * side and dithered**2 > DITHER_DENSITY * side * places


def estimate_noise_mm(depth_mm: Depth, step_px: int = 1) -> float | None:
    """Estimate the standard deviation of the noise on the surfaces of an (H, W) depth map, mm.

    None if too few pixels have depth without an edge. Larger distances of the compared pixels
    (step_px) also show smooth noise, but are more affected by curvature.
    """
    size, inner = _second_differences(depth_mm, step_px)
    if np.count_nonzero(inner) < LEAST_WINDOWS:
        return None
    return float(_noise_of(np.sqrt(size[inner]).mean()))


def noise_share(spectrum: Array) -> float:
    """Compute the share of correlated noise that ``estimate_noise_mm`` measures between neighbours.

    The noise has an (H, W) power spectrum of mean 1, as ``numpy.fft.fft2`` orders it.
    """
    seen = np.abs(np.fft.fft2(_KERNEL, spectrum.shape)) ** 2
    return float(np.sqrt((seen * spectrum).mean()) / GAIN)


def local_noise_mm(depth_mm: Depth, otherwise_mm: float) -> Depth:
    """Estimate the noise around each pixel, (H, W) float32 mm; ``otherwise_mm`` off surfaces."""
    size, inner = _second_differences(depth_mm, 1)
    share = cv2.blur(inner.astype(np.float32), _LOCAL_PX)
    roots = cv2.blur(np.where(inner, np.sqrt(size), np.float32(0)), _LOCAL_PX)
    known = share > 1 / 3
    mean = np.divide(roots, share, out=np.zeros_like(roots), where=known)
    local: Depth = np.where(known, np.maximum(_noise_of(mean), _LEAST_MM), otherwise_mm)
    return local.astype(np.float32)


def _second_differences(depth_mm: Depth, step_px: int) -> tuple[Depth, Mask]:
    """Compute second differences, (H, W) mm, and the mask of windows without an edge."""
    # The depths of such a window span less than JUMP_MM per pixel of step.
    side = 2 * step_px + 1
    square = np.ones((side, side), np.uint8)
    # Holes are 0 and so make edges.
    span = cv2.dilate(depth_mm, square) - cv2.erode(depth_mm, square)
    inner = (depth_mm > 0) & (span < JUMP_MM * step_px)
    inner[:step_px] = inner[-step_px:] = False
    inner[:, :step_px] = inner[:, -step_px:] = False
    kernel = np.zeros((side, side), np.float32)
    kernel[::step_px, ::step_px] = _KERNEL
    return np.abs(cv2.filter2D(depth_mm, cv2.CV_32F, kernel)), inner


def _noise_of(mean_root: Any) -> Any:
    """Convert the mean square root of second differences to the noise's standard deviation, mm."""
    return (mean_root / MEAN_ROOT) ** 2 / GAIN


def trusted_mask(depth_mm: Depth, risk_mm: Depth | None) -> Mask:
    """Mark (H, W) pixels near measured depth with a low expected error of the chosen surface."""
    side = 2 * REACH_PX + 1
    measured = depth_mm > 0
    near: Mask = cv2.dilate(measured.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    if risk_mm is None:
        return near
    return near & (risk_mm < np.where(measured, MEASURED_RISK_MM, HOLE_RISK_MM))
