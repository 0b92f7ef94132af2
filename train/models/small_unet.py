"""A small U-Net for the CPU: large receptive field, few full-size convolutions, no norm layers."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import torch
import torch.nn.functional as F  # noqa: N812
from pydantic import Field
from torch import Tensor, nn

from glsim.networks.record import AROUND_PX
from glsim.train.models.backbone import Backbone, Blocks, Scales, Width, init_he, pad_to_multiple


class SmallUNet(Backbone):
    """U-Net with ``blocks`` residual blocks per scale and direction; skips are added.

    (B, in_channels, H, W) to (B, out_channels, H, W); sizes that 2^(scales - 1) does not divide are
    padded inside. Scale s has (1 + growth * s) * ``width`` channels, less than doubling from scale
    to scale, for a small file. 2x2 means go down, linear interpolation goes up.

    Parameters at 14 -> 14 (`MaskAware` with ``surfaces`` and ``uncertainty``): 411,102 with width
    32, 4 scales and a growth of 0.5 (1.6 MB). Widths of 16 and multiples are fastest.
    """

    def __init__(
        self, in_channels: Width = 1, out_channels: Width = 1, width: Width = 24,
        scales: Scales = 3, blocks: Blocks = 1, growth: Annotated[float, Field(ge=0, le=8)] = 0.5,
        residual: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(in_channels, out_channels, residual)
        # Measured: 48 px with four scales and 80 px with five, see AROUND_PX.
        self.margin_px = max(AROUND_PX, 16 + 2 ** (scales + 1))
        widths = [round(width * (1 + growth * scale)) for scale in range(scales)]
        # With this gain, the variance stays about constant through all residual blocks.
        gain = (blocks * (2 * scales - 1)) ** -0.5

        def level(channels: int) -> nn.Sequential:
            return nn.Sequential(*(ResidualBlock(channels, gain) for _ in range(blocks)))

        self.first = nn.Conv2d(in_channels, width, 3, padding=1)
        self.encoder = nn.ModuleList(level(channels) for channels in widths)
        self.widen = nn.ModuleList(nn.Conv2d(fine, coarse, 1) for fine, coarse in pairwise(widths))
        self.narrow = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in pairwise(widths))
        self.decoder = nn.ModuleList(level(channels) for channels in widths[:-1])
        self.last = nn.Conv2d(width, out_channels, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """Run the network on (B, in_channels, H, W)."""
        features = self.encoder[0](self.first(pad_to_multiple(x, 2 ** len(self.widen))))
        skips = []
        for widen, encoder in zip(self.widen, self.encoder[1:], strict=True):
            skips.append(features)
            features = encoder(widen(F.avg_pool2d(features, 2)))
        for narrow, decoder in zip(reversed(self.narrow), reversed(self.decoder), strict=True):
            coarse = F.interpolate(
                narrow(features), scale_factor=2, mode="bilinear", align_corners=False
            )
            features = decoder(skips.pop() + coarse)
        correction: Tensor = self.last(features)[..., : x.shape[-2], : x.shape[-1]]
        return x + correction if self.residual else correction


class ResidualBlock(nn.Module):
    """Residual block x + conv(relu(conv(relu(x)))) with 3x3 convolutions."""

    def __init__(self, channels: int, gain: float) -> None:
        super().__init__()
        self.one = nn.Conv2d(channels, channels, 3, padding=1)
        self.two = nn.Conv2d(channels, channels, 3, padding=1)
        for layer in (self.one, self.two):
            init_he(layer)
        with torch.no_grad():
            self.two.weight.mul_(gain)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        inner: Tensor = self.two(torch.relu(self.one(torch.relu(x))))
        return x + inner
