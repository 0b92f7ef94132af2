"""Estimate the scale of a head from the width of its face."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Width over the cheek bones as measured below: mean of 100 random ICT-FaceKit heads, whose unit
#: is known (standard deviation 7.8 mm). Adults have 137 mm by calliper.
FACE_WIDTH_MM = 141.0

#: Depth of the measured part behind the tip of the nose, in face widths: it includes the widest
#: part of the cheeks and excludes the ears.
_DEPTH = 0.55
_ITERATIONS = 30


def mm_per_unit(vertices: NDArray[np.floating]) -> float:
    """Return the millimetres per unit that make the face FACE_WIDTH_MM wide; 0 without a width.

    The width is measured less than 0.55 widths behind the nose tip and up to 0.4 widths above it,
    by fixed-point iteration.

    Args:
        vertices: (V, 3) of a neutral head, y up, z out of the face.
    """
    x, y, z = vertices.T
    middle, width = (x.min() + x.max()) / 2, float(np.ptp(x))
    for _ in range(_ITERATIONS):
        near = np.abs(x - middle) < 0.1 * width
        if not near.any():
            return 0.0
        tip_y, tip_z = y[near][np.argmax(z[near])], z[near].max()
        front = (z > tip_z - _DEPTH * width) & (y > tip_y) & (y < tip_y + 0.4 * width)
        if not front.any():
            return 0.0
        narrower = float(np.ptp(x[front]))
        if abs(narrower - width) <= 1e-6 * width:
            break
        width = narrower
    return FACE_WIDTH_MM / width if width > 0 else 0.0
