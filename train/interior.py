"""Where a surface can be judged: away from its rims, as the evaluation draws the line."""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor
from torch.nn import functional

#: The evaluation's: so far from an edge is the interior, and such a difference is an edge.
BAND_PX: Final = 3
JUMP_MM: Final = 30.0


def interior(clean_mm: Tensor) -> Tensor:
    """(B, 1, H, W) bool: depth, more than BAND_PX from no depth and from jumps between surfaces.

    As the evaluation draws it (``eval/metrics/score.py``, which this layer may not import; a test
    compares the two).
    """
    valid = clean_mm > 0
    jump = torch.zeros_like(valid)
    for axis in (-2, -1):
        size = clean_mm.shape[axis] - 1
        first, second = clean_mm.narrow(axis, 0, size), clean_mm.narrow(axis, 1, size)
        edge = ((second - first).abs() > JUMP_MM) & (first > 0) & (second > 0)
        jump.narrow(axis, 0, size).logical_or_(edge)
        jump.narrow(axis, 1, size).logical_or_(edge)
    near_hole = grown(~valid, BAND_PX)
    near_jump = grown(jump & valid, BAND_PX - 1)
    return valid & ~near_hole & ~near_jump


def grown(mask: Tensor, radius: int) -> Tensor:
    """(B, 1, H, W) bool: at most so many pixels, in rows and in columns, from the mask."""
    side = 2 * radius + 1
    rows = functional.max_pool2d(mask.float(), (1, side), 1, (0, radius))  # one axis at a time:
    return functional.max_pool2d(rows, (side, 1), 1, (radius, 0)) > 0  # side, not side^2, reads
