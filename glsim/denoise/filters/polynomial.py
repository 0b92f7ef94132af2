"""Local polynomial regression on valid pixels, vectorised over the image.

Around each pixel a polynomial in the offsets (u, v) is fitted by least squares, weighted by a
Gaussian times the mask; its constant term is the estimate. The normal equations need only the sums
of w u^p v^q and w u^p v^q z, which are separable convolutions of the mask and of the masked depth
(Fan and Gijbels 1996; Farnebaeck 2002 for images with certainties).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import Depth, Mask

_Array = NDArray[np.float64]

#: Radius of the window in standard deviations.
_REACH = 2.5
#: Relative ridge weight that pulls slope and curvature to 0: negligible where the pixels determine
#: them, decisive where they do not (pixels in a line, fewer pixels than coefficients).
_RIDGE = 1e-6


def local_polynomial(
    depth_mm: Depth, support: Mask, wanted: Mask, sigma_px: float, degree: int
) -> Depth:
    """Estimate depth at the N pixels of ``wanted`` from those of ``support``, both (H, W).

    depth_mm: (H, W). degree: 0 mean, 1 plane, 2 quadric. Returns (N,) millimetres, 0 without
    support.
    """
    radius = max(1, math.ceil(_REACH * sigma_px))
    offset = np.arange(-radius, radius + 1) / radius
    bell = np.exp(-0.5 * (offset * radius / sigma_px) ** 2)
    powers = [
        (p, q) for order in range(degree + 1) for p in range(order, -1, -1) for q in [order - p]
    ]
    mask = support.astype(np.float64)
    middle = float(np.median(depth_mm[support]))
    masked = np.where(support, depth_mm - middle, 0.0)

    def moment(image: _Array, p: int, q: int) -> _Array:
        row, column = bell * offset**p, bell * offset**q
        full = cv2.sepFilter2D(image, cv2.CV_64F, row, column, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(full[wanted], np.float64)

    needed = {(a + c, b + d) for a, b in powers for c, d in powers}
    weights = {power: moment(mask, *power) for power in needed}
    left = np.stack(
        [np.stack([weights[a + c, b + d] for c, d in powers], -1) for a, b in powers], -2
    )
    right = np.stack([moment(masked, p, q) for p, q in powers], -1)
    total = weights[0, 0]
    # Without support the sums are 0 up to rounding; the smallest real weight is far larger.
    some = total > 1e-6
    size = len(powers)
    ridge = np.diag([0.0] + [_RIDGE] * (size - 1))
    left = np.where(some[:, None, None], left + total[:, None, None] * ridge, np.eye(size))
    solved = np.linalg.solve(left, right[..., None])[:, 0, 0]
    estimate: Depth = np.where(some, np.maximum(solved + middle, 0.0), 0.0).astype(np.float32)
    return estimate
