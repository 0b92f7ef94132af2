"""Match rectified images by OpenCV's semi-global matcher; reject and average like a camera.

Hirschmueller, "Stereo Processing by Semiglobal Matching and Mutual Information", PAMI 30(2), 2008.
All computation uses whole numbers: the same bytes on every machine and for any number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Floats

Disparities = NDArray[np.int32]
Matched = NDArray[np.int16]
#: Steps per pixel of disparities, and of the positions where the second image is interpolated.
STEPS_PER_PX, _TAP_STEPS = 256, 16
_TAP_BITS = 4
#: Largest change by ``_align``, 1/256 px. Chosen: half a pixel; image detail repeats beyond it.
_MOST = 128
#: Steps per pixel of OpenCV's disparities; ``match`` returns steps of 1 / STEPS_PER_PX.
_MATCHED_STEPS = 16
#: The disparity of a pixel without a match.
NO_MATCH = -1
#: Replaces NO_MATCH where disparities are subtracted, 1/256 px: 2,000 px below all disparities.
_FAR_OFF = -(1 << 19)
#: Standard deviation of an image after ``_even_contrast``, counts. Chosen: dots just fit 8 bits.
_EVEN_COUNTS = 40


def match(left: Floats, right: Floats, p: Mapping[str, float]) -> Disparities:
    """Match two rectified images of whole counts by the parameters of ``match_stereo``.

    The second camera stands to the right of the first. Returns the (H, W) int32 disparities of
    ``left`` in 1/256 px, -1 without a match.
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
    # OpenCV does not match columns whose search range leaves the image: a border adds columns.
    border = searched + shift
    if p["contrast_px"] > 0:
        side, floor = int(p["contrast_px"]) | 1, p["contrast_floor_counts"]
        views = [_even_contrast(image, side, floor) for image in (left, right)]
    else:
        views = [_bytes(image) for image in (left, right)]
    padded = [cv2.copyMakeBorder(i, 0, 0, border, 0, cv2.BORDER_REPLICATE) for i in views]
    matched: Matched = matcher.compute(*padded)[:, border:].astype(np.int16)
    matched[matched <= shift * _MATCHED_STEPS] = NO_MATCH
    if p["texture_counts"] > 0:
        side = int(p["texture_px"] or window) | 1
        matched[_local_moments(left, side)[1] < p["texture_counts"] ** 2] = NO_MATCH
    if p["smallest_region_px"] > 0:
        step = max(int(p["region_step_px"] * _MATCHED_STEPS), 1)
        cv2.filterSpeckles(matched, NO_MATCH, int(p["smallest_region_px"]) - 1, step)
    if (rim := int(p["rim_px"])) > 0:
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1,) * 2)
        behind = cv2.dilate(matched, around) - matched
        matched[behind > int(p["rim_step_px"] * _MATCHED_STEPS)] = NO_MATCH
    along = int(p["support_px"])
    across = int(p["support_across_px"]) or along
    found = matched.astype(np.int32) * (STEPS_PER_PX // _MATCHED_STEPS)
    found[matched < 0] = NO_MATCH
    found = _support_mean(found, along, across, p["support_step_px"])
    if p["refine_px"] > 0:
        window_px = int(p["refine_px"]) | 1, int(p["refine_across_px"] or p["refine_px"]) | 1
        for _ in range(int(p["refine_rounds"])):
            found, apart = _align(found, views[0], views[1], window_px)
            if p["refine_mean"] > 0:
                found = _support_mean(found, along, across, p["support_step_px"])
        if p["unlike_medians"] > 0 and (found >= 0).any():
            found[apart > p["unlike_medians"] * np.median(apart[found >= 0])] = NO_MATCH
    return found


def _even_contrast(image: Floats, side_px: int, floor_counts: float) -> NDArray[np.uint8]:
    """Normalise an image to a local mean of 128 and a local standard deviation of at most 40."""
    mean, variance = _local_moments(image, side_px)
    even = 128 + _EVEN_COUNTS * (image - mean) / np.maximum(np.sqrt(variance), floor_counts)
    return np.asarray(np.rint(even.clip(0, 255)).astype(np.uint8))


def _local_moments(image: Floats, side_px: int) -> tuple[Array, Array]:
    """Compute the mean (counts) and the variance (counts^2) of the window around each pixel."""
    import cv2

    size, count = (side_px, side_px), side_px**2
    # The sums of counts and of their squares are whole numbers, exact in float64.
    counts = image.astype(np.float64)
    total = cv2.boxFilter(counts, cv2.CV_64F, size, normalize=False)
    squares = cv2.boxFilter(counts * counts, cv2.CV_64F, size, normalize=False)
    return total / count, (count * squares - total * total) / count**2


def reject_unlit(found: Disparities, pattern: Floats, window: int) -> None:
    """Reject, in place, disparities (1/256 px) whose window in the pattern is constant."""
    # A projector's image may be smaller than the camera's view.
    row, column = np.nonzero(found >= 0)
    there = np.maximum(column - (found[row, column] + STEPS_PER_PX // 2) // STEPS_PER_PX, 0)
    unlit = _local_moments(pattern, window)[1][row, there] == 0
    found[row[unlit], column[unlit]] = NO_MATCH


def _support_mean(
    values: Disparities, along_px: int, across_px: int, step_px: float
) -> Disparities:
    """Average disparities that differ by less than a step, along rows, then along columns."""
    step = int(step_px * STEPS_PER_PX)
    for axis, side_px in ((1, along_px), (0, across_px)):
        values = _mean_along(values, axis, side_px // 2, step)
    return values


def _mean_along(values: Disparities, axis: int, reach: int, step: int) -> Disparities:
    """Average the neighbours within ``reach`` on an axis that differ by less than ``step``."""
    known = values >= 0
    own = np.where(known, values, _FAR_OFF)  # differs by more than a step from every disparity
    # The mean is the pixel's value plus the mean of the neighbours' differences from it.
    total, count = np.zeros(values.shape, np.int32), np.ones(values.shape, np.int32)
    for shift in range(1, min(reach, values.shape[axis] - 1) + 1):
        ahead = (slice(None),) * axis + (slice(shift, None),)
        behind = (slice(None),) * axis + (slice(None, -shift),)
        apart = own[ahead] - own[behind]
        alike = np.abs(apart) < step
        apart *= alike
        total[ahead] -= apart
        total[behind] += apart
        count[ahead] += alike
        count[behind] += alike
    return np.where(known, own + (total + (count >> 1)) // count, NO_MATCH)


def _bytes(counts: Floats) -> NDArray[np.uint8]:
    """Convert an image of counts to 8 bits; bright images lose their lowest bits."""
    largest = int(counts.max(initial=0.0))
    return (counts.astype(np.int32) >> max(largest.bit_length() - 8, 0)).astype(np.uint8)


def _align(
    found: Disparities, left: NDArray[np.uint8], right: NDArray[np.uint8],
    window_px: tuple[int, int],
) -> tuple[Disparities, Array]:  # fmt: skip
    """Refine disparities: minimise the squared differences between the windows of two images.

    It does one step of Lucas and Kanade, "An Iterative Image Registration Technique" (1981), in
    whole numbers. Disparities from a parabola through three matching costs are biased towards whole
    pixels by up to 0.2 px; after this step the bias is 0.03 px.

    Args:
        found: (H, W) smooth disparities, 1/256 px.
        left, right: (H, W) images of even contrast; the second camera stands to the right.
        window_px: sides of the window along the baseline and across it, odd.

    Returns the disparities, and each pixel's difference between the images before, (H, W) counts.
    """
    import cv2

    width = found.shape[1]
    fine = STEPS_PER_PX // _TAP_STEPS
    coarse = (found + fine // 2) >> _TAP_BITS  # 1/16 px; -1 becomes 0
    place = (np.arange(width, dtype=np.int32) << _TAP_BITS) - coarse
    first = place >> _TAP_BITS
    known = (found >= 0) & (first >= 1) & (first < width - 2)
    seen, steep = _interpolated(right, np.where(known, first, 1), place & (_TAP_STEPS - 1))
    # Fixed point: counts have the factor 2^13, slopes 2^9, disparities 2^8, differences 2^17.
    apart = ((left.astype(np.int32) << 13) - seen) * fine
    apart -= steep * ((coarse << _TAP_BITS) - found)
    steep[~known] = 0
    # Sums of whole numbers below 2^53 are exact in float64, in any order of the terms.
    slopes = steep.astype(np.float64)
    above, below = (
        cv2.boxFilter(
            slopes * part, cv2.CV_64F, window_px, normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        for part in (apart.astype(np.float64), slopes)
    )
    # A larger disparity lies further left in the second image: the slope's sign changes.
    step = np.rint(-above / np.maximum(below, 1.0)).clip(-_MOST, _MOST)
    refined = np.where(known, found + step.astype(np.int32), found)
    return refined, np.abs(apart) / 2.0**17


def _interpolated(
    image: NDArray[np.uint8], first: Disparities, share: Disparities
) -> tuple[Disparities, Disparities]:
    """Interpolate counts (times 2 x 16^3) and slope (times 2 x 16^2) between pixels of a row.

    The interpolation is Catmull and Rom's cubic through two pixels before and two after.
    ``first`` is the column of the last pixel before, and ``share`` the distance from it in 1/16 px;
    both are (H, W).
    """
    height, width = image.shape
    flat = image.ravel()
    at = first + np.arange(0, height * width, width, dtype=np.int32)[:, None]
    before, here, there, after = (flat.take(at + k).astype(np.int32) for k in (-1, 0, 1, 2))
    n = _TAP_STEPS
    # Coefficients of the cubic in powers of the share f: 2 ``there`` + b f + c f^2 + d f^3.
    b = there - before
    c = 2 * before - 5 * here + 4 * there - after
    d = 3 * (here - there) + after - before
    value = ((d * share + n * c) * share + n * n * b) * share + 2 * n**3 * here
    slope = (3 * d * share + 2 * n * c) * share + n * n * b
    return value, slope
