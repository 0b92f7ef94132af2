"""Smooth falloff functions, and the array types of this package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array

IntArray = NDArray[np.int32]
Vec3 = tuple[float, float, float]


def smoothstep(low: Array | float, high: Array | float, value: Array) -> Array:
    """Interpolate smoothly from 0 at ``low`` to 1 at ``high``; low > high is valid too."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def bump(offset: Array, width: float) -> Array:
    """Return exp(-(offset/width)^2): 1 at 0, 0.37 at ``width``, 0.02 at twice ``width``."""
    return np.asarray(np.exp(-np.square(offset / width)))
