"""Move disparities to where the windows of two images differ least in squares.

One step of Lucas and Kanade, "An Iterative Image Registration Technique" (1981), in whole numbers:
the same bytes on every machine. A parabola through the costs of three disparities prefers whole
pixels by up to 0.2 px; after one step 0.03 px of that is left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Disparities = NDArray[np.int32]

#: Steps per pixel of disparities, and of the places at which the second image is interpolated.
STEPS_PER_PX, _TAP_STEPS = 256, 16
_TAP_BITS = 4
#: Largest step, 1/256 px; chosen: half a pixel, beyond which images repeat.
_MOST = 128


def align(
    found: Disparities,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    window_px: tuple[int, int],
) -> Disparities:
    """Return better disparities of ``left``, (H, W) int32 in 1/256 px, -1 without a match.

    Args:
        found: (H, W) in 1/256 px, smooth.
        left, right: (H, W) images of even contrast; the second camera stands to the right.
        window_px: sides of the window along the baseline and across it, odd.
    """
    import cv2

    width = found.shape[1]
    fine = STEPS_PER_PX // _TAP_STEPS
    coarse = (found + fine // 2) >> _TAP_BITS  # 1/16 px; -1 becomes 0
    place = (np.arange(width, dtype=np.int32) << _TAP_BITS) - coarse
    first = place >> _TAP_BITS
    known = (found >= 0) & (first >= 1) & (first < width - 2)
    seen, steep = _interpolated(right, np.where(known, first, 1), place & (_TAP_STEPS - 1))
    # Scales: counts 2^13, slope 2^9; disparities 2^8: all differences get 2^17, below 2^27.
    apart = ((left.astype(np.int32) << 13) - seen) * fine
    apart -= steep * ((coarse << _TAP_BITS) - found)
    steep[~known] = 0
    # Sums of whole numbers below 2^53 are exact in float64, in any order.
    slopes = steep.astype(np.float64)
    above, below = (
        cv2.boxFilter(
            slopes * part, cv2.CV_64F, window_px, normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        for part in (apart.astype(np.float64), slopes)
    )
    # A larger disparity looks farther to the left: the slope's sign turns.
    step = np.rint(-above / np.maximum(below, 1.0)).clip(-_MOST, _MOST)
    return np.where(known, found + step.astype(np.int32), found)


def _interpolated(
    image: NDArray[np.uint8], first: Disparities, share: Disparities
) -> tuple[Disparities, Disparities]:
    """Return counts, times 2 x 16^3, and their slope, times 2 x 16^2, between pixels of a row.

    By Catmull and Rom's cubic through the two pixels before and the two after.

    Args:
        image: (H, W) counts.
        first: (H, W) column of the last pixel before.
        share: (H, W) how far behind it, 1/16 px.
    """
    height, width = image.shape
    flat = image.ravel()
    at = first + np.arange(0, height * width, width, dtype=np.int32)[:, None]
    before, here, there, after = (flat.take(at + k).astype(np.int32) for k in (-1, 0, 1, 2))
    n = _TAP_STEPS
    # Coefficients of the cubic in powers of the share: 2 here + b f + c f^2 + d f^3.
    b = there - before
    c = 2 * before - 5 * here + 4 * there - after
    d = 3 * (here - there) + after - before
    value = ((d * share + n * c) * share + n * n * b) * share + 2 * n**3 * here
    slope = (3 * d * share + 2 * n * c) * share + n * n * b
    return value, slope
