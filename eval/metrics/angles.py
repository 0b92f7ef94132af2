"""Surface normals of depth maps, and the angles between them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import Mask

_Array = NDArray[np.float64]


def whole_windows(mask: Mask) -> Mask:
    """Return (H, W) pixels whose whole 3x3 neighbourhood is in the image and in the mask."""
    inside = np.zeros_like(mask)
    if min(mask.shape) >= 3:
        eroded = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
        inside[1:-1, 1:-1] = eroded[1:-1, 1:-1] > 0
    return inside


def angles_deg(first: _Array, second: _Array) -> _Array:
    """Compute (N,) angles in degrees between (N, 3) vectors; accurate for small angles too."""
    x1, y1, z1 = first.T
    x2, y2, z2 = second.T
    cross = (y1 * z2 - z1 * y2) ** 2 + (z1 * x2 - x1 * z2) ** 2 + (x1 * y2 - y1 * x2) ** 2
    angle: _Array = np.degrees(np.arctan2(np.sqrt(cross), x1 * x2 + y1 * y2 + z1 * z2))
    return angle
