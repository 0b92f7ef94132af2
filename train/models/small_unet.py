"""A small U-Net for the CPU: wide view, few full-size convolutions, no normalisation layers."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

import torch
import torch.nn.functional as F  # noqa: N812
from pydantic import Field
from torch import Tensor, nn

from glsim.train.models.backbone import Backbone, Blocks, Scales, Width, init_zero, pad_to_multiple

_ACTIVATIONS = {"relu": nn.ReLU, "silu": nn.SiLU}


class SmallUNet(Backbone):
    """``blocks`` residual blocks per scale on the way down and up; skips are added.

    (B, in_channels, H, W) to (B, out_channels, H, W); sizes that 2^(scales - 1) does not divide are
    padded inside. Scale s has (1 + growth * s) * ``width`` channels: coarse scales cost little
    time, but doubled widths would make the weights too large to ship. 2x2 means go down, linear
    interpolation goes up: the untrained network causes no aliasing and no blocks.

    stem: 0, or the channels of two full-size convolutions before and after a U-Net at half the
    size, which takes half of the time per step (0.65 to 0.35 s for 8 frames of 128 x 128 on two
    cores). FFDNet (Zhang, Zuo and Zhang, TIP 2018) showed that denoising at half the size costs
    little; the stem keeps single pixels.
    Parameters at 6 -> 2, as `MaskAware` builds it, with one block per scale: width 24 and 4 scales
    228,638; width 32 and 4 scales 405,330; width 44, 3 scales and a stem of 16 442,902 (1.8 MB).
    """

    def __init__(
        self,
        in_channels: Width = 1,
        out_channels: Width = 1,
        width: Width = 24,
        scales: Scales = 3,
        blocks: Blocks = 1,
        growth: Annotated[float, Field(ge=0, le=8)] = 0.5,
        stem: Annotated[int, Field(ge=0, le=4096)] = 0,
        activation: Literal["relu", "silu"] = "relu",
        residual: bool = True,
        zero_last: bool = False,
    ) -> None:
        super().__init__(in_channels, out_channels, residual)
        widths = [round(width * (1 + growth * scale)) for scale in range(scales)]
        # Keeps the variance about constant through so many residual blocks in a row.
        gain = (blocks * (2 * scales - 1)) ** -0.5

        def level(channels: int) -> nn.Sequential:
            return nn.Sequential(
                *(ResidualBlock(channels, activation, gain) for _ in range(blocks))
            )

        self.stem = Stem(in_channels, out_channels, stem, width) if stem else None
        inner, outer = (width, width) if stem else (in_channels, out_channels)
        self.first = nn.Conv2d(inner, width, 3, padding=1)
        self.encoder = nn.ModuleList(level(channels) for channels in widths)
        self.widen = nn.ModuleList(nn.Conv2d(fine, coarse, 1) for fine, coarse in pairwise(widths))
        self.narrow = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in pairwise(widths))
        self.decoder = nn.ModuleList(level(channels) for channels in widths[:-1])
        self.last = nn.Conv2d(width, outer, 3, padding=1)
        if zero_last:
            init_zero(self.stem.last if self.stem else self.last)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """Denoise."""
        halvings = len(self.widen) + (self.stem is not None)
        padded = pad_to_multiple(x, 2**halvings)
        if self.stem is None:
            correction = self._unet(padded)
        else:
            fine = self.stem.fine(padded)
            correction = self.stem.joined(fine, self._unet(self.stem.halved(fine)))
        correction = correction[..., : x.shape[-2], : x.shape[-1]]
        return x + correction if self.residual else correction

    def _unet(self, x: Tensor) -> Tensor:
        features = self.encoder[0](self.first(x))
        skips = []
        for widen, encoder in zip(self.widen, self.encoder[1:], strict=True):
            skips.append(features)
            features = encoder(widen(F.avg_pool2d(features, 2)))
        for narrow, decoder in zip(reversed(self.narrow), reversed(self.decoder), strict=True):
            coarse = F.interpolate(
                narrow(features), scale_factor=2, mode="bilinear", align_corners=False
            )
            features = decoder(skips.pop() + coarse)
        out: Tensor = self.last(features)
        return out


class Stem(nn.Module):
    """Full-size layers around a network at half the size.

    ``fine``: (B, in_channels, H, W) to (B, channels, H, W). ``halved``: to (B, width, H/2, W/2).
    ``joined``: fine features and the inner network's (B, width, H/2, W/2) to the output.
    """

    def __init__(self, in_channels: int, out_channels: int, channels: int, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(in_channels, channels, 3, padding=1)
        # Kernels of 4 at a stride of 2 overlap, so that blocks of 2x2 pixels leave no pattern.
        self.down = nn.Conv2d(channels, width, 4, stride=2, padding=1)
        self.up = nn.ConvTranspose2d(width, channels, 4, stride=2, padding=1)
        self.last = nn.Conv2d(channels, out_channels, 3, padding=1)

    def fine(self, x: Tensor) -> Tensor:
        """Extract full-size features."""
        return F.relu(self.first(x))

    def halved(self, fine: Tensor) -> Tensor:
        """Reduce them to half the size."""
        return F.relu(self.down(fine))

    def joined(self, fine: Tensor, inner: Tensor) -> Tensor:
        """Enlarge the inner network's output and join it with the full-size features."""
        out: Tensor = self.last(F.relu(fine + self.up(inner)))
        return out


class ResidualBlock(nn.Module):
    """x + conv(act(conv(act(x)))) with 3x3 convolutions."""

    def __init__(self, channels: int, activation: str, gain: float) -> None:
        super().__init__()
        self.one = nn.Conv2d(channels, channels, 3, padding=1)
        self.two = nn.Conv2d(channels, channels, 3, padding=1)
        self.activation = _ACTIVATIONS[activation]()
        for layer in (self.one, self.two):
            nn.init.kaiming_normal_(layer.weight, mode="fan_in")
            nn.init.zeros_(layer.bias)
        with torch.no_grad():
            self.two.weight.mul_(gain)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        inner: Tensor = self.two(self.activation(self.one(self.activation(x))))
        return x + inner
