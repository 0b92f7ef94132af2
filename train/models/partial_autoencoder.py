"""An autoencoder of partial convolutions: the network of Sterzentsenko et al.

V. Sterzentsenko et al., "Self-Supervised Deep Depth Denoising", ICCV 2019. The layout is that of
the authors' public code (VCL3D/DeepDepthDenoising, MIT), from which no line is taken: nine
convolutions down with three halvings, two residual blocks with activation first, nine convolutions
up with three doublings by interpolation, ELU throughout, and features of each scale joined to those
on the way up.
"""

from __future__ import annotations

from itertools import pairwise

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from glsim.train.models.backbone import Backbone, Width, init_he, init_zero, pad_to_multiple
from glsim.train.models.partial_conv import PartialConv2d

#: Channels of the four scales in multiples of ``width``, finest first, as published.
_WIDTHS = (2, 4, 8, 8)


class PartialAutoencoder(Backbone):
    """Partial convolutions on four scales; ``width`` is that of the first layer, published 8.

    (B, in_channels, H, W) and valid (B, 1, H, W) to (B, out_channels, H, W); sizes that 8 does not
    divide are padded with holes inside. The first two layers have windows of 7 and 5 pixels, all
    others of 3. The published network puts out depth itself, without a residual.
    Parameters at 1 -> 1: width 8 468,209; width 4 117,433.
    """

    def __init__(
        self,
        in_channels: Width = 1,
        out_channels: Width = 1,
        width: Width = 8,
        residual: bool = False,
        zero_last: bool = False,
    ) -> None:
        super().__init__(in_channels, out_channels, residual)
        widths = [times * width for times in _WIDTHS]
        self.encoder = nn.ModuleList(
            [_Chain((in_channels, width, widths[0]), sizes=(7, 5))]
            + [
                _Chain((fine, coarse, coarse, coarse), stride=2)
                for fine, coarse in pairwise(widths[:3])
            ]
        )
        self.narrowest = _Chain((widths[2], widths[3]), stride=2)
        self.blocks = nn.ModuleList(PreactivatedBlock(widths[3]) for _ in range(2))
        # From the coarsest scale up. The finest has one layer fewer here: the last has no ELU.
        finer = widths[2::-1]
        self.up = nn.ModuleList(
            _Chain((coarse, fine)) for coarse, fine in zip(widths[:0:-1], finer, strict=True)
        )
        self.join = nn.ModuleList(nn.Conv2d(2 * fine, fine, 1) for fine in finer)
        self.decoder = nn.ModuleList(
            [_Chain((fine, fine, fine)) for fine in finer[:2]] + [_Chain((finer[2], width))]
        )
        self.last = PartialConv2d(width, out_channels)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d):
                init_he(layer)
        if zero_last:
            init_zero(self.last)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """Denoise; without ``valid`` every pixel counts as measured."""
        mask = torch.ones_like(x[:, :1]) if valid is None else valid.to(x.dtype)
        features, mask = pad_to_multiple(x, 8), _pad_with_holes(mask, 8)
        skips = []
        for down in self.encoder:
            features, mask = down(features, mask)
            skips.append(features)
        features, mask = self.narrowest(features, mask)
        for block in self.blocks:
            features, mask = block(features, mask)
        for up, join, decoder in zip(self.up, self.join, self.decoder, strict=True):
            features, mask = (F.interpolate(part, scale_factor=2) for part in (features, mask))
            features, mask = up(features, mask)
            features = F.elu(join(torch.cat([features, skips.pop()], dim=1)))
            features, mask = decoder(features, mask)
        correction: Tensor = self.last(features, mask)[0][..., : x.shape[-2], : x.shape[-1]]
        return x + correction if self.residual else correction


class PreactivatedBlock(nn.Module):
    """x + conv(elu(conv(elu(x)))) with 3x3 partial convolutions."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.one = PartialConv2d(channels, channels)
        self.two = PartialConv2d(channels, channels)

    def forward(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Map features (B, C, H, W) and mask (B, 1, H, W) to the same shapes."""
        inner, grown = self.one(F.elu(x), mask)
        inner, grown = self.two(F.elu(inner), grown)
        return x + inner, grown


class _Chain(nn.Module):
    """Partial convolutions, each followed by ELU; the first has the stride."""

    def __init__(
        self, channels: tuple[int, ...], sizes: tuple[int, ...] | None = None, stride: int = 1
    ) -> None:
        super().__init__()
        count = len(channels) - 1
        self.layers = nn.ModuleList(
            PartialConv2d(
                channels[i],
                channels[i + 1],
                size=sizes[i] if sizes else 3,
                stride=1 if i else stride,
            )
            for i in range(count)
        )

    def forward(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        for layer in self.layers:
            x, mask = layer(x, mask)
            x = F.elu(x)
        return x, mask


def _pad_with_holes(mask: Tensor, multiple: int) -> Tensor:
    """Pad (B, 1, H, W) to the right and below with 0, to multiples of a number."""
    height, width = mask.shape[-2:]
    return F.pad(mask, (0, -width % multiple, 0, -height % multiple))
