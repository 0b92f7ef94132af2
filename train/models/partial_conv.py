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
    """w * (x m) * n / sum(m) + b where a window of n pixels holds a measured one, 0 elsewhere.

    x (B, before, H, W) and mask (B, 1, H, W) of 0 and 1 to (B, after, H, W) and the mask grown by
    half a window, both of H / stride x W / stride. Pixels beyond the image count as not measured.
    size: side of the window, odd.
    """

    def __init__(self, before: int, after: int, size: int = 3, stride: int = 1) -> None:
        super().__init__(before, after, size, stride=stride, padding=size // 2)

    def forward(  # type: ignore[override]  # the mask goes along
        self, x: Tensor, mask: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Convolve."""
        assert self.bias is not None
        share = F.avg_pool2d(mask, self.kernel_size, self.stride, self.kernel_size[0] // 2)
        seen = share > 0
        known = torch.where(mask > 0, x, 0.0)
        summed = F.conv2d(known, self.weight, stride=self.stride, padding=self.padding)
        grown = seen.to(mask.dtype)
        bias = self.bias.view(1, -1, 1, 1)
        return (summed / torch.where(seen, share, 1.0) + bias) * grown, grown


class PartialConvNet(MaskedStack):
    """A `MaskedStack` of partial convolutions with as many parameters as the same `DnCNN`.

    Depth 7, 1 channel in and out: 185,857 parameters.
    """

    layer = PartialConv2d
