"""Random surface bumps and slopes that are added to clean and noisy frames alike, as augmentation.

A network trained on embedded heads alone learns that skin is as smooth as they are, and smooths
away what other faces have: lids, creases, nostrils. With bumps and creases of any size, drawn anew
for each frame, only the noise is left to remove.

Slopes are for floors and tables: training frames show mostly people and walls, and a network that
has seen few steep planes bends them.

The noise of a pair was drawn for the surface without bumps. That is right to first order: noise
depends on distance and tilt, which change little where the slope of the bumps is small.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

#: Sizes of the bumps (sigma of a Gaussian, px) and their heights relative to the largest: from
#: creases to cheekbones at 0.9 m, 2.5 mm per pixel; all sizes are about equally steep.
_SIZES_PX: Final = (1.2, 2.5, 5.0, 10.0)
_HEIGHTS: Final = (0.25, 0.5, 0.75, 1.0)
#: Sigma of the patches that contain bumps, px: a face is not rough everywhere.
_PATCH_PX: Final = 12.0
#: Share of frames without bumps; share of sizes drawn as creases instead of bumps.
_UNTOUCHED, _CREASED = 0.25, 0.5
#: Share of frames without a slope, and the most of the nearest depth that a slope may take away.
_LEVEL, _NEARER = 0.5, 0.5


def draw_surface_bumps(
    shape: tuple[int, int], height_mm: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw (H, W) float32 millimetres to add to depth.

    Args:
        height_mm: upper limit of the standard deviation of the largest bumps.
    """
    total_mm = np.zeros(shape, np.float32)
    if rng.random() < _UNTOUCHED:
        return total_mm
    for size_px, height in zip(_SIZES_PX, _HEIGHTS, strict=True):
        bumps = _smooth_noise(shape, size_px, rng)
        if rng.random() < _CREASED:
            bumps = (1 - 1.5 * np.abs(bumps)).astype(np.float32)
        patches = np.clip(_smooth_noise(shape, _PATCH_PX, rng), 0, 2)
        total_mm += (height_mm * rng.random() ** 2 * height * bumps * patches).astype(np.float32)
    return total_mm


def draw_slope(
    shape: tuple[int, int], largest_mm_per_px: float, nearest_mm: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Draw (H, W) float32 millimetres to add to depth: a plane through 0 in the middle.

    Args:
        largest_mm_per_px: upper limit of its slope; small ones are more frequent.
        nearest_mm: least depth of the frame; the slope is reduced so that half of it remains.
    """
    if rng.random() < _LEVEL:
        return np.zeros(shape, np.float32)
    angle = rng.uniform(0, 2 * np.pi)
    down, right = (np.arange(size, dtype=np.float32) - (size - 1) / 2 for size in shape)
    plane = np.sin(angle) * down[:, None] + np.cos(angle) * right
    slope = largest_mm_per_px * rng.random() ** 2
    limit = _NEARER * nearest_mm / max(float(np.abs(plane).max()), 1e-6)
    added_mm: NDArray[np.float32] = (min(slope, limit) * plane).astype(np.float32)
    return added_mm


def _smooth_noise(
    shape: tuple[int, int], sigma_px: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Gaussian noise, blurred and scaled to variance 1."""
    white = rng.standard_normal(shape, dtype=np.float32)
    smooth = np.asarray(cv2.GaussianBlur(white, (0, 0), sigma_px), np.float32)
    return smooth / max(float(smooth.std()), 1e-6)
