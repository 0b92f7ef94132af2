"""Pixels without depth: their share by radius, and their changes between frames."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from glsim.core.array_types import Reals
from glsim.core.depth_frame import DepthFrame
from glsim.measures.measured_frame import radius_px

#: Bounds of the rings, px of a Kinect V2, whose corners are at 330 px.
RINGS_PX = (0.0, 50.0, 100.0, 150.0, 200.0, 225.0, 250.0, 275.0, 300.0, 340.0)


def measure_invalid(frames: Sequence[DepthFrame]) -> tuple[tuple[float, float, float], ...]:
    """Compute (inner px, outer px, share without depth) for each ring; NaN outside the image."""
    missing, pixels = np.zeros((2, len(RINGS_PX) - 1))
    for frame in frames:
        radius = radius_px(frame)
        missing += np.histogram(radius[~np.isfinite(frame.measured_mm)], RINGS_PX)[0]
        pixels += np.histogram(radius, RINGS_PX)[0]
    share = np.where(pixels > 0, missing / np.maximum(pixels, 1), np.nan)
    return tuple((*ring, float(s)) for ring, s in zip(pairwise(RINGS_PX), share, strict=True))


def measure_isolated(frames: Sequence[DepthFrame]) -> tuple[float, float]:
    """Compute the shares of all pixels that are single holes, and single depths.

    Of a single hole's eight neighbours at least seven have depth; of a single depth's at most one.
    """
    ring = np.ones((3, 3), np.float32) - np.pad(np.ones((1, 1), np.float32), 1)
    counts = np.zeros(3)
    for frame in frames:
        known = np.isfinite(frame.measured_mm)
        near = cv2.filter2D(known.astype(np.float32), -1, ring, borderType=cv2.BORDER_CONSTANT)
        counts += (~known & (near > 6.5)).sum(), (known & (near < 1.5)).sum(), known.size
    return float(counts[0] / counts[2]), float(counts[1] / counts[2])


def hole_share_beside_band(images: Sequence[Reals]) -> float:
    """Compute the share of holes to the right of the left border band, over all images.

    Images are (H, W) depth or disparity, NaN = none. The width of a stereo camera's band is the
    disparity there, which depends on the room and not on the matcher. The band ends at the first
    pixel with depth of each row; a row without depth counts as holes.
    """
    holes, pixels = 0, 0
    for image in images:
        known = np.isfinite(image)
        right = np.maximum.accumulate(known, axis=1) | ~known.any(axis=1, keepdims=True)
        holes += int((right & ~known).sum())
        pixels += int(right.sum())
    return holes / pixels


def flip_share(images: Sequence[Reals], pairs: Sequence[tuple[int, int]]) -> float:
    """Compute the share of pixels with depth in only one frame, mean of the pairs; NaN if empty."""
    if not pairs:
        return float("nan")
    return float(np.mean([(np.isnan(images[a]) != np.isnan(images[b])).mean() for a, b in pairs]))
