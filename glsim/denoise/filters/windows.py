"""Helpers for depth maps with masks: fill holes, cut neighbourhoods, clean masks."""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import Depth, Mask

_T = TypeVar("_T", bound=np.generic)

#: A pixel farther than this from the local median, mm, belongs to no surface there: more than the
#: noise of any shipped sensor, less than the step from a nose to a cheek.
FLYING_MM = 30.0
#: Neighbours of one piece differ by at most this, mm: more than any slope of a face at 3 mm per
#: pixel, less than the step to a wall.
_STEP_MM = 50.0


def fill(depth_mm: Depth, support: Mask) -> Depth:
    """Fill holes with the depth of the nearest ``support`` pixel, (H, W); all 0 without any."""
    if not support.any():
        return np.zeros_like(depth_mm)
    _, labels = cv2.distanceTransformWithLabels(
        (~support).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    values = np.zeros(int(labels.max()) + 1, np.float32)
    values[labels[support]] = depth_mm[support]
    filled: Depth = values[labels]
    return filled


def around(image: NDArray[_T], radius: int, at: Mask, outside: float) -> NDArray[_T]:
    """Cut the square neighbourhoods, (N, (2 radius + 1)^2), of the N pixels of ``at``.

    outside: the value beyond the image.
    """
    padded = np.pad(image, radius, constant_values=outside)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1,) * 2)
    return windows[at].reshape(int(np.count_nonzero(at)), (2 * radius + 1) ** 2)


def clean_up(depth_mm: Depth, valid: Mask, size: int) -> tuple[Mask, Mask]:
    """Clean a mask; return the trusted pixels and the pixels that shall have depth, (H, W) bool.

    Trusted pixels are valid and within FLYING_MM of their 5x5 median. Pixels get depth where more
    than half of a square of ``size`` px is trusted: this closes single holes, removes single
    islands and straightens ragged silhouettes.
    """
    filled = fill(depth_mm, valid)
    trusted = valid & (np.abs(filled - cv2.medianBlur(filled, 5)) <= FLYING_MM)
    share = cv2.blur(trusted.astype(np.float32), (size, size), borderType=cv2.BORDER_REPLICATE)
    return trusted, share > 0.5


def pieces(depth_mm: Depth, valid: Mask) -> NDArray[np.int32]:
    """Label the 4-connected surfaces of an (H, W) map, with steps up to 50 mm; 0 = no depth."""
    # Connected components know a mask only, so steps become gaps between pixels at twice the size.
    height, width = valid.shape
    grid = np.zeros((2 * height - 1, 2 * width - 1), np.uint8)
    grid[::2, ::2] = valid
    for axis, target in ((0, grid[1::2, ::2]), (1, grid[::2, 1::2])):
        step = np.abs(np.diff(depth_mm, axis=axis)) <= _STEP_MM
        both = np.delete(valid, 0, axis) & np.delete(valid, -1, axis)
        target[...] = step & both
    _, labels = cv2.connectedComponents(grid, connectivity=4)
    return np.where(valid, labels[::2, ::2], 0).astype(np.int32)
