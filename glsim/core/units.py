"""Units of depth: metres in geometry, millimetres in measurements, whole steps in files.

A depth of 0 means "no depth" in all three. Other modules convert by these functions:
``tests/core/test_units.py`` refuses a literal 1000 beside a depth.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DepthRangeError

MM_PER_M: Final = 1000.0
M_PER_MM: Final = 1 / MM_PER_M
#: The largest value of a 16-bit file.
UINT16_MAX: Final = 65535


def to_metres(depth_mm: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Convert millimetres to float32 metres."""
    return np.asarray(depth_mm / np.float32(MM_PER_M), np.float32)


def to_mm(depth_m: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Convert metres to float32 millimetres."""
    return np.asarray(depth_m * np.float32(MM_PER_M), np.float32)


def to_steps(depth_m: NDArray[np.floating[Any]], step_mm: float = 1.0) -> NDArray[np.uint16]:
    """Round depth, metres, 0 = none, to uint16 steps; every positive depth is at least 1 step.

    Raises DepthRangeError if a depth exceeds 65535 steps.
    """
    steps = np.rint(depth_m * np.float32(MM_PER_M / step_mm))
    if steps.max(initial=0.0) > UINT16_MAX:
        raise DepthRangeError(
            f"a depth of {steps.max() * step_mm:.0f} mm does not fit 16 bits in steps of "
            f"{step_mm} mm: choose a larger output.depth_unit_mm"
        )
    np.maximum(steps, 1.0, out=steps, where=depth_m > 0)
    whole: NDArray[np.uint16] = steps.astype(np.uint16)
    return whole


def from_steps(
    steps: NDArray[np.unsignedinteger[Any]], step_mm: float = 1.0, offset_mm: float = 0.0
) -> NDArray[np.float32]:
    """Convert whole steps of any shape, 0 = none, to float32 mm: the inverse of ``to_steps``.

    ``offset_mm`` was subtracted before the depth was rounded; it is added again.
    """
    depth_mm: NDArray[np.float32] = steps * np.float32(step_mm)
    if offset_mm:
        np.add(depth_mm, np.float32(offset_mm), out=depth_mm, where=steps > 0)
    return depth_mm


def subtract_offset(
    depth: NDArray[np.float32], offset: float, least: float = 1.0
) -> NDArray[np.float32]:
    """Subtract an offset from depth; 0, no depth, stays 0, other depth is at least ``least``.

    Args:
        depth: float32, 0 = none.
        offset: in the unit of the depth.
        least: smallest result, in the same unit. Noisy depth before the surface's nearest point is
            raised to it, because a depth of 0 would be a hole.
    """
    moved = np.maximum(depth - np.float32(offset), np.float32(least))
    return np.where(depth > 0, moved, np.float32(0.0))


def add_offset(depth: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    """Add an offset to depth; for depths above ``least`` this inverts ``subtract_offset``."""
    return np.where(depth > 0, depth + np.float32(offset), np.float32(0.0))
