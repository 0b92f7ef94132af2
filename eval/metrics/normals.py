"""Surface normals of depth maps, compared."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..types import Mask

_Array = NDArray[np.float64]


def whole_windows(mask: Mask) -> Mask:
    """Pixels whose 3x3 neighbourhood lies in the mask, all of it within the image."""
    inside = np.zeros_like(mask)
    if min(mask.shape) >= 3:
        eroded = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
        inside[1:-1, 1:-1] = eroded[1:-1, 1:-1] > 0
    return inside


def normals_at(depth_mm: NDArray[np.floating], rays: NDArray[np.floating], at: Mask) -> _Array:
    """(N, 3) normals, not of unit length, at the N pixels of ``at`` in row order.

    depth_mm: (H, W); rays: (H, W, 2), x/z and y/z of each pixel. The cross product of the central
    differences of the back-projected points; ``at`` must keep off the image's border.
    """
    row, column = np.nonzero(at)

    def point(dy: int, dx: int) -> tuple[_Array, _Array, _Array]:
        z = depth_mm[row + dy, column + dx].astype(np.float64)
        ray = rays[row + dy, column + dx].astype(np.float64)
        return ray[:, 0] * z, ray[:, 1] * z, z

    ax, ay, az = (b - a for a, b in zip(point(0, -1), point(0, 1), strict=True))
    bx, by, bz = (b - a for a, b in zip(point(-1, 0), point(1, 0), strict=True))
    return np.stack([by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax], axis=-1)


def angles_deg(first: _Array, second: _Array) -> _Array:
    """(N,) angles between (N, 3) vectors, degrees; exact for small ones too."""
    x1, y1, z1 = first.T
    x2, y2, z2 = second.T
    cross = (y1 * z2 - z1 * y2) ** 2 + (z1 * x2 - x1 * z2) ** 2 + (x1 * y2 - y1 * x2) ** 2
    angle: _Array = np.degrees(np.arctan2(np.sqrt(cross), x1 * x2 + y1 * y2 + z1 * z2))
    return angle
