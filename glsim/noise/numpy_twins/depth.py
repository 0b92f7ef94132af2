"""Twins of shaders/lib/depth.glsl and shaders/lib/disparity.glsl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

#: The smallest depth that a pixel with depth can be moved to, m.
_LEAST_M = np.float32(1e-4)


def moved_by_mm(depth_m: Image, by_mm: Image) -> Image:
    """Move depth (metres) along the axis by millimetres; 0 = no depth stays 0."""
    moved = np.maximum(depth_m + np.float32(0.001) * by_mm, _LEAST_M)
    return np.where(depth_m > 0, moved, np.float32(0.0))


def disparity_px(depth_m: Image, focal_baseline_px_m: float) -> Image:
    """Depth, m, to disparity, px, and back; undefined for pixels without depth."""
    known = np.where(depth_m > 0, depth_m, np.float32(1.0))
    return np.divide(np.float32(focal_baseline_px_m), known, dtype=np.float32)


def displaced(depth_m: Image, by_mm: Image, by_px: Image, focal_baseline_px_m: float) -> Image:
    """Move depth (metres) by millimetres and by pixels of disparity."""
    if by_px.any():
        shifted = disparity_px(depth_m, focal_baseline_px_m) + by_px
        moved = np.float32(focal_baseline_px_m) / np.maximum(shifted, np.float32(1e-3))
        depth_m = np.where((depth_m > 0) & (by_px != 0), moved, depth_m)
    return moved_by_mm(depth_m, by_mm)
