"""Interior of a depth map: the pixels away from its rims, defined as in the evaluation."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from glsim.core.edges import BAND_PX, JUMP_MM


def interior_mask(clean_mm: Tensor) -> Tensor:
    """Mark pixels with depth more than BAND_PX from holes and from jumps: (B, 1, H, W) bool.

    Equals the interior of ``eval/metrics/prediction.py``, which training may not import; a test
    compares the two.
    """
    valid = clean_mm > 0
    jump = torch.zeros_like(valid)
    for axis in (-2, -1):
        size = clean_mm.shape[axis] - 1
        first, second = clean_mm.narrow(axis, 0, size), clean_mm.narrow(axis, 1, size)
        edge = ((second - first).abs() > JUMP_MM) & (first > 0) & (second > 0)
        jump.narrow(axis, 0, size).logical_or_(edge)
        jump.narrow(axis, 1, size).logical_or_(edge)
    near_hole = dilated(~valid, BAND_PX)
    near_jump = dilated(jump & valid, BAND_PX - 1)
    return valid & ~near_hole & ~near_jump


def dilated(mask: Tensor, radius_px: int) -> Tensor:
    """Dilate a (B, 1, H, W) mask by a square of half side ``radius_px``; bool."""
    side = 2 * radius_px + 1
    # A pass per axis reads ``side`` pixels, a single pass would read side^2.
    rows = functional.max_pool2d(mask.float(), (1, side), 1, (0, radius_px))
    return functional.max_pool2d(rows, (side, 1), 1, (radius_px, 0)) > 0
