"""Partial convolutions: each window is averaged over its measured pixels only.

G. Liu, F. A. Reda, K. J. Shih, T.-C. Wang, A. Tao, B. Catanzaro, "Image Inpainting for Irregular
Holes Using Partial Convolutions", ECCV 2018, equations 1 and 2.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from glsim.train.models.masked_stack import MaskedStack


class PartialConv2d(nn.Conv2d):
    """3x3: w * (x m) * 9 / sum(m) + b where the window holds a measured pixel, 0 where it does not.

    x (B, before, H, W) and mask (B, 1, H, W) of 0 and 1 to (B, after, H, W) and the mask grown by
    one pixel. Pixels beyond the image count as not measured.
    """

    def __init__(self, before: int, after: int) -> None:
        super().__init__(before, after, 3, padding=1)

    def forward(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Convolve."""
        share = F.avg_pool2d(mask, 3, stride=1, padding=1)
        seen = share > 0
        summed = F.conv2d(torch.where(mask > 0, x, 0.0), self.weight, padding=1)
        grown = seen.to(mask.dtype)
        bias = self.bias.view(1, -1, 1, 1)
        return (summed / torch.where(seen, share, 1.0) + bias) * grown, grown


class PartialConvNet(MaskedStack):
    """A `MaskedStack` of partial convolutions; as many parameters as `DnCNN` of the same depth and
    width (1 -> 1, depth 7: 185,857).
    """

    layer = PartialConv2d
