"""Normalised convolutions: each pixel is weighted by a confidence, which layers pass on.

H. Knutsson, C.-F. Westin, "Normalized and Differential Convolution", CVPR 1993; layers that pass
the confidence on: A. Eldesokey, M. Felsberg, F. S. Khan, "Propagating Confidences through CNNs for
Sparse Data Regression", BMVC 2018.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from glsim.train.models.masked_stack import MaskedStack

_TINY = 1e-4  # prevents 0 / 0; small beside a confidence of 1, and lost to it in half precision


class NormalizedConv2d(nn.Conv2d):
    """3x3: (w * (x c)) sum(a) / (a * c) + b with confidence (a * c) / sum(a), where a = |w|.

    In Knutsson and Westin's terms ``a`` is the applicability and the sign of ``w`` the basis.
    Eldesokey et al. have no signs: each of their layers is a mean, which can fill holes but cannot
    tell a pixel from its neighbours. With full confidence this is an ordinary convolution.

    x (B, before, H, W) and confidence (B, 1 or before, H, W) in 0-1 to both as (B, after, H, W).
    Pixels beyond the image have confidence 0. Costs two convolutions.
    """

    def __init__(self, before: int, after: int) -> None:
        super().__init__(before, after, 3, padding=1)

    def forward(  # type: ignore[override]  # the confidence goes along
        self, x: Tensor, confidence: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Convolve."""
        assert self.bias is not None
        confidence = confidence.expand_as(x)
        applicability = self.weight.abs()
        total = applicability.sum(dim=(1, 2, 3)).view(1, -1, 1, 1) + _TINY
        known = torch.where(confidence > 0, x, 0.0) * confidence
        trust = F.conv2d(confidence, applicability, padding=1) / total
        mean = F.conv2d(known, self.weight, padding=1) / (trust + _TINY)
        return mean + self.bias.view(1, -1, 1, 1), trust


class NormalizedConvNet(MaskedStack):
    """A `MaskedStack` of normalised convolutions with as many parameters as the same `DnCNN`.

    Depth 7, 1 channel in and out: 185,857 parameters.
    """

    layer = NormalizedConv2d
