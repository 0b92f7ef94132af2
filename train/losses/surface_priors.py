"""Priors on a denoised surface: near the measured one, and with normals that change slowly."""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor
from torch.nn import functional

from glsim.train.losses.base import weighted_mean

#: The inverse Huber distance is linear up to this share of the largest error of the batch (I. Laina
#: et al., "Deeper Depth Prediction with Fully Convolutional Residual Networks", 3DV 2016).
_LINEAR_SHARE: Final = 0.2
#: Neighbours in half of the directions, (rows, columns); the others are the same pairs again.
_NEIGHBOURS: Final = ((0, 1), (1, 0), (1, 1), (1, -1))


def inverse_huber(error: Tensor, mask: Tensor) -> Tensor:
    """Mean inverse Huber distance (berHu) over the pixels of a mask, in units of the error.

    Linear up to a fifth of the largest error in the mask, quadratic above.

    Args:
        error: (B, 1, H, W).
        mask: (B, 1, H, W) bool, pixels that count.
    """
    size = torch.where(mask, error, 0.0).abs()
    limit = (_LINEAR_SHARE * size.detach().max()).clamp_min(torch.finfo(size.dtype).tiny)
    squared = (size.square() / limit + limit) / 2
    return weighted_mean(torch.where(size <= limit, size, squared), mask.float())


def normal_smoothness(depth_mm: Tensor, mask: Tensor, focal_px: float) -> Tensor:
    """Mean of 1 - |cosine| between the normals of neighbouring pixels, 0 on planes.

    Args:
        depth_mm: (B, 1, H, W).
        mask: (B, 1, H, W) bool, pixels that count; a normal needs four neighbours in it.
        focal_px: focal length. Rays within 3 x 3 px are taken as parallel.
    """
    normal, known = _normals(depth_mm, mask, focal_px)
    losses, weights = [], []
    for rows, columns in _NEIGHBOURS:
        cosine = (_shifted(normal, rows, columns) * _base(normal, rows, columns)).sum(1, True)
        losses.append((1 - cosine.abs()).flatten())
        both = _shifted(known, rows, columns) & _base(known, rows, columns)
        weights.append(both.float().flatten())
    return weighted_mean(torch.cat(losses), torch.cat(weights))


def _normals(depth_mm: Tensor, mask: Tensor, focal_px: float) -> tuple[Tensor, Tensor]:
    """Unit normals (B, 3, H, W) from central differences, and where they are known; without rim."""
    left, right = depth_mm[..., 1:-1, :-2], depth_mm[..., 1:-1, 2:]
    above, below = depth_mm[..., :-2, 1:-1], depth_mm[..., 2:, 1:-1]
    known = mask[..., 1:-1, 1:-1] & mask[..., 1:-1, :-2] & mask[..., 1:-1, 2:]
    known = known & mask[..., :-2, 1:-1] & mask[..., 2:, 1:-1]
    middle = torch.where(known, depth_mm[..., 1:-1, 1:-1], 1.0)
    pitch_mm = 2 * middle / focal_px
    slopes = [torch.where(known, step, 0.0) / pitch_mm for step in (left - right, above - below)]
    normal = torch.cat([*slopes, torch.ones_like(middle)], dim=1)
    return functional.normalize(normal, dim=1), known


def _base(image: Tensor, rows: int, columns: int) -> Tensor:
    """Cut an image to the pixels that have a neighbour at this distance."""
    height, width = image.shape[-2:]
    first = max(0, -columns)
    return image[..., : height - rows, first : width - max(0, columns)]


def _shifted(image: Tensor, rows: int, columns: int) -> Tensor:
    """Cut an image to the neighbours of the pixels of `_base`; ``rows`` is at least 0."""
    first = max(0, columns)
    return image[..., rows:, first : image.shape[-1] + min(0, columns)]
