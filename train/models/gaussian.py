"""Gaussian means of images with unknown pixels, for the features of networks."""

from __future__ import annotations

import math
from typing import Final

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

#: A smaller sum of weights is a rounding error: the window has no known pixel.
TINY: Final = 1e-6
#: Share of zeros that `shrunk_mean` adds to a neighbourhood.
_LEAST_SHARE: Final = 0.02


def weighted_mean(
    depth_mm: Tensor, known: Tensor, radius: int, sigma: float
) -> tuple[Tensor, Tensor]:
    """Compute the Gaussian mean of the known pixels.

    ``depth_mm`` and ``known`` (0 or 1) are (B, C, H, W); radius and sigma are in pixels. Returns
    the mean, 0 without known pixels, and the mask (0 or 1) of windows with known pixels.
    """
    total, weight = blurred(torch.cat([depth_mm * known, known]), radius, sigma).chunk(2)
    reached = weight > TINY
    mean = torch.where(reached, total / torch.where(reached, weight, 1.0), 0.0)
    return mean, reached.to(known.dtype)


def shrunk_mean(values: Tensor, known: Tensor, radius: int, sigma: float) -> Tensor:
    """Compute `weighted_mean` with 2 % zeros added, which shrinks means of few known pixels."""
    total, weight = blurred(torch.cat([values * known, known]), radius, sigma).chunk(2)
    return total / (weight + _LEAST_SHARE)


def blurred(images: Tensor, radius: int, sigma: float) -> Tensor:
    """Blur (B, C, H, W) images by a Gaussian of ``sigma`` px; pixels outside are 0.

    Rows, then columns as rows: onnxruntime computes a convolution of one row at a time four times
    as fast as a sum of shifted images, and twice as fast as a convolution of images.
    """
    taps = [math.exp(-0.5 * (x / sigma) ** 2) for x in range(-radius, radius + 1)]
    kernel = (torch.tensor(taps) / sum(taps)).to(images)[None, None]
    for _ in range(2):
        rows = images.reshape(-1, 1, images.shape[-1])
        images = F.conv1d(rows, kernel, padding=radius).reshape(images.shape).transpose(-1, -2)
    return images
