"""Match rectified images: OpenCV's semi-global matcher, and what a camera rejects and averages.

Hirschmueller, "Stereo Processing by Semiglobal Matching and Mutual Information", PAMI 30(2), 2008.
All is in whole numbers: the same bytes on every machine and for any number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Disparities = NDArray[np.int32]
Matched = NDArray[np.int16]
Counts = NDArray[np.float32]

#: Steps per pixel of what ``match`` returns, and of OpenCV's disparities.
STEPS_PER_PX, _MATCHED_STEPS = 256, 16
#: A disparity that is none.
NO_MATCH = -1
#: Standard deviation of an image of even contrast, counts: its dots then just fit 8 bits. Chosen.
_EVEN_COUNTS = 40
#: Largest step of the refinement, 1/256 px; chosen: half a pixel, beyond which images repeat.
_MOST_REFINED = 128


def match(left: Counts, right: Counts, p: Mapping[str, float]) -> Disparities:
    """Match rectified images whose second camera stands to the right of the first.

    Args:
        left, right: (H, W) whole counts.
        p: parameters of the stage ``match_stereo``.

    Returns:
        (H, W) int32 disparities of ``left`` in 1/256 px, -1 without a match.
    """
    import cv2

    searched, shift = int(p["disparities"]) // 16 * 16, int(p["disparity_shift"])
    window = int(p["window_px"]) | 1
    p1, p2 = int(p["p1"]) * window**2, int(p["p2"]) * window**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=shift,
        numDisparities=searched,
        blockSize=window,
        P1=p1,
        P2=max(p2, p1 + 1),
        disp12MaxDiff=int(p["left_right_px"]),
        preFilterCap=int(p["prefilter_counts"]),
        uniquenessRatio=int(p["uniqueness_percent"]),
        mode=cv2.StereoSGBM_MODE_SGBM_3WAY,
    )
    # OpenCV leaves out the columns whose search would leave the second image: a border holds it.
    border = searched + shift
    if p["contrast_px"] > 0:
        side, floor = int(p["contrast_px"]) | 1, p["contrast_floor_counts"]
        views = [_even_contrast(image, side, floor) for image in (left, right)]
    else:
        views = [_bytes(image) for image in (left, right)]
    padded = [cv2.copyMakeBorder(i, 0, 0, border, 0, cv2.BORDER_REPLICATE) for i in views]
    matched: Matched = matcher.compute(*padded)[:, border:].astype(np.int16)
    matched[matched <= shift * _MATCHED_STEPS] = NO_MATCH
    _reject_flat(matched, left, window, p["texture_counts"])
    if p["smallest_region_px"] > 0:
        step = max(int(p["region_step_px"] * _MATCHED_STEPS), 1)
        cv2.filterSpeckles(matched, NO_MATCH, int(p["smallest_region_px"]) - 1, step)
    _reject_rims(matched, int(p["rim_px"]), int(p["rim_step_px"] * _MATCHED_STEPS))
    along = int(p["support_px"])
    across = int(p["support_across_px"]) or along
    found = matched.astype(np.int32) * (STEPS_PER_PX // _MATCHED_STEPS)
    found[matched < 0] = NO_MATCH
    found = _support_mean(found, along, across, p["support_step_px"])
    if p["refine_px"] > 0:
        window_px = int(p["refine_px"]) | 1, int(p["refine_across_px"] or p["refine_px"]) | 1
        for _ in range(int(p["refine_rounds"])):
            found = _refined(found, views[0], views[1], window_px)
            if p["refine_mean"] > 0:
                found = _support_mean(found, along, across, p["support_step_px"])
    return found


def _even_contrast(image: Counts, side_px: int, floor_counts: float) -> NDArray[np.uint8]:
    """Return an image with its local mean at 128 and its local standard deviation at most 40."""
    mean, variance = _local_moments(image, side_px)
    even = 128 + _EVEN_COUNTS * (image - mean) / np.maximum(np.sqrt(variance), floor_counts)
    clipped: NDArray[np.uint8] = np.rint(even.clip(0, 255)).astype(np.uint8)
    return clipped


def _local_moments(image: Counts, side_px: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and variance of the window around each pixel, counts."""
    import cv2

    size, count = (side_px, side_px), side_px**2
    # Sums of counts and of their squares are whole numbers, exact in float64.
    counts = image.astype(np.float64)
    total = cv2.boxFilter(counts, cv2.CV_64F, size, normalize=False)
    squares = cv2.boxFilter(counts * counts, cv2.CV_64F, size, normalize=False)
    return total / count, (count * squares - total * total) / count**2


def _reject_flat(matched: Matched, image: Counts, window: int, least_counts: float) -> None:
    """Reject, in place, pixels in whose window the image's standard deviation is too small."""
    if least_counts > 0:
        matched[_local_moments(image, window)[1] < least_counts**2] = NO_MATCH


def reject_unlit(found: Disparities, pattern: Counts, window: int) -> None:
    """Reject, in place, matches with a part of the pattern that is the same all over the window.

    Args:
        found: (H, W) in 1/256 px.
        pattern: (H, W) counts; a projector's image need not fill the view.
    """
    row, column = np.nonzero(found >= 0)
    there = np.maximum(column - (found[row, column] + STEPS_PER_PX // 2) // STEPS_PER_PX, 0)
    unlit = _local_moments(pattern, window)[1][row, there] == 0
    found[row[unlit], column[unlit]] = NO_MATCH


def _reject_rims(matched: Matched, reach_px: int, step: int) -> None:
    """Reject, in place, pixels within ``reach_px`` of one whose disparity is larger by ``step``."""
    import cv2

    if reach_px > 0:
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1,) * 2)
        matched[cv2.dilate(matched, around) - matched > step] = NO_MATCH


def _support_mean(
    values: Disparities, along_px: int, across_px: int, step_px: float
) -> Disparities:
    """Average disparities over the neighbours that continue the surface, first rows, then columns.

    Args:
        values: (H, W) in 1/256 px, -1 without a match.
        along_px, across_px: sides of the region along the baseline and across it.
        step_px: a neighbour that differs by more does not count.
    """
    step = int(step_px * STEPS_PER_PX)
    for axis, side_px in ((1, along_px), (0, across_px)):
        values = _mean_along(values, axis, side_px // 2, step)
    return values


def _mean_along(values: Disparities, axis: int, reach: int, step: int) -> Disparities:
    """Average along one axis over ``reach`` neighbours on both sides that differ by less."""
    total, count = values.copy(), np.ones(values.shape, np.int32)
    for shift in range(1, reach + 1):
        ahead = (slice(None),) * axis + (slice(shift, None),)
        behind = (slice(None),) * axis + (slice(None, -shift),)
        if shift >= values.shape[axis]:
            break
        one, other = values[ahead], values[behind]
        alike = (np.abs(one - other) < step) & (one >= 0) & (other >= 0)
        total[ahead] += np.where(alike, other, 0)
        total[behind] += np.where(alike, one, 0)
        count[ahead] += alike
        count[behind] += alike
    mean = (total + (count >> 1)) // count
    return np.where(values >= 0, mean, NO_MATCH)


def _bytes(counts: Counts) -> NDArray[np.uint8]:
    """Return an image of counts as 8 bits; brighter images lose their lowest bits."""
    largest = int(counts.max(initial=0.0))
    shift = max(largest.bit_length() - 8, 0)
    return (counts.astype(np.int32) >> shift).astype(np.uint8)


#: Steps per pixel at which the second image is interpolated by ``_refined``.
_TAP_STEPS = 16


@lru_cache(maxsize=1)
def _cubic_taps() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (16, 4) whole weights of Catmull and Rom's cubic, times 2 x 16^3, and of its slope.

    Weights of the four pixels around a place between the second and the third; the slope's are
    times 2 x 16^2.
    """
    n = _TAP_STEPS
    f = np.arange(n)[:, None]
    value = [
        -(f**3) + 2 * n * f**2 - n**2 * f,
        3 * f**3 - 5 * n * f**2 + 2 * n**3,
        -3 * f**3 + 4 * n * f**2 + n**2 * f,
        f**3 - n * f**2,
    ]
    slope = [
        -3 * f**2 + 4 * n * f - n**2,
        9 * f**2 - 10 * n * f,
        -9 * f**2 + 8 * n * f + n**2,
        3 * f**2 - 2 * n * f,
    ]
    return np.hstack(value).astype(np.int64), np.hstack(slope).astype(np.int64)


def _refined(
    found: Disparities,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    window_px: tuple[int, int],
) -> Disparities:
    """Move disparities to where the windows of the two images differ least in squares.

    One step of Lucas and Kanade (1981). A parabola through three costs prefers whole pixels by up
    to 0.2 px; this does by less than a tenth of that. Sums of whole numbers below 2^53 are exact in
    float64.

    Args:
        found: (H, W) in 1/256 px, smooth.
        left, right: (H, W) images of even contrast.
        window_px: sides of the window along the baseline and across it.
    """
    import cv2

    height, width = found.shape
    known = found >= 0
    fine = STEPS_PER_PX // _TAP_STEPS
    coarse = (found + fine // 2) // fine  # 1/16 px
    column = np.arange(width, dtype=np.int64) * _TAP_STEPS - coarse
    first = np.floor_divide(column, _TAP_STEPS)
    share = column - first * _TAP_STEPS
    known &= (first >= 1) & (first < width - 2)
    first = np.where(known, first, 1)
    row = np.arange(height)[:, None]
    value, slope = _cubic_taps()
    seen, steep = np.zeros(found.shape, np.int64), np.zeros(found.shape, np.int64)
    for tap in range(4):
        counts = right[row, first + tap - 1].astype(np.int64)
        seen += value[share, tap] * counts
        steep += slope[share, tap] * counts
    # Scales: counts 2^13, slope 2^9; disparities 2^8: all differences get 2^17.
    apart = (left.astype(np.int64) * (2 * _TAP_STEPS**3) - seen) * fine
    apart -= steep * (coarse * fine - found)
    steep[~known] = 0
    size, border = window_px, cv2.BORDER_CONSTANT
    above = cv2.boxFilter(
        (steep * apart).astype(np.float64), cv2.CV_64F, size, normalize=False, borderType=border
    )
    below = cv2.boxFilter(
        (steep * steep).astype(np.float64), cv2.CV_64F, size, normalize=False, borderType=border
    )
    # A larger disparity looks farther to the left: the slope's sign turns.
    step = np.rint(-above / np.maximum(below, 1.0)).clip(-_MOST_REFINED, _MOST_REFINED)
    return np.where(known, found + step.astype(np.int32), found)
