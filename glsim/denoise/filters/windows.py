"""Helpers of filters for depth maps with masks: fill holes, clean masks."""

from __future__ import annotations

import cv2
import numpy as np

from glsim.core.array_types import Depth, Mask
from glsim.core.depth_map import JUMP_MM


def fill(depth_mm: Depth, support: Mask) -> Depth:
    """Fill holes with the depth of the nearest ``support`` pixel, (H, W); all 0 without any."""
    if not support.any():
        return np.zeros_like(depth_mm)
    _, labels = cv2.distanceTransformWithLabels(
        (~support).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    values = np.zeros(int(labels.max()) + 1, np.float32)
    values[labels[support]] = depth_mm[support]
    return np.asarray(values[labels])


def clean_up(depth_mm: Depth, valid: Mask, size: int) -> tuple[Mask, Mask]:
    """Clean a mask; return the trusted pixels and the pixels that shall have depth, (H, W) bool.

    Trusted pixels are valid and within JUMP_MM of their 5x5 median. Pixels get depth where more
    than half of a square of ``size`` px is trusted: this closes single holes, removes single
    islands and straightens ragged silhouettes.
    """
    filled = fill(depth_mm, valid)
    trusted = valid & (np.abs(filled - cv2.medianBlur(filled, 5)) <= JUMP_MM)
    share = cv2.blur(trusted.astype(np.float32), (size, size), borderType=cv2.BORDER_REPLICATE)
    return trusted, share > 0.5
