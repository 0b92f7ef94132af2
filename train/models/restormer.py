"""Restormer, a U-shaped transformer with attention between channels, not between pixels.

S. W. Zamir, A. Arora, S. Khan, M. Hayat, F. S. Khan, M.-H. Yang, "Restormer: Efficient Transformer
for High-Resolution Image Restoration", CVPR 2022. Written from the paper (sections 3, 3.1, 3.2 and
the implementation details of section 4).
"""

from __future__ import annotations

from typing import Annotated, Final

import torch
import torch.nn.functional as F  # noqa: N812
from pydantic import Field
from torch import Tensor, nn

from glsim.core.errors import ConfigError
from glsim.train.models.backbone import Backbone, Blocks, Width, pad_to_multiple

Levels = tuple[Blocks, Blocks, Blocks, Blocks]
#: Ratio of the channels inside a feed-forward network to those at its ends, as in the paper.
_EXPANSION: Final = 2.66


class Restormer(Backbone):
    """Restormer with four levels; ``blocks`` and ``heads`` are listed from fine to coarse levels.

    (B, in_channels, H, W) to (B, out_channels, H, W); sizes that 8 does not divide are padded
    inside. Attention compares channels over the whole image, so the results of a crop and of the
    whole frame differ. Parameters at 1 -> 1: 26,109,076; with dim 16, blocks 1-1-1-2 and one
    refinement block 1,004,819.
    """

    def __init__(
        self, in_channels: Width = 1, out_channels: Width = 1,
        dim: Annotated[int, Field(ge=8, le=512, multiple_of=8)] = 48, blocks: Levels = (4, 6, 6, 8),
        heads: Levels = (1, 2, 4, 8), refinement: Blocks = 4, residual: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(in_channels, out_channels, residual)

        def level(channels: int, scale: int, count: int) -> nn.Sequential:
            return nn.Sequential(*(TransformerBlock(channels, heads[scale]) for _ in range(count)))

        dims = [dim * 2**scale for scale in range(4)]
        if any(channels % count for channels, count in zip(dims, heads, strict=True)):
            raise ConfigError(f"Restormer: heads {heads} do not divide the channels {tuple(dims)}")
        self.first = _conv(in_channels, dim, 3)
        self.encoder = nn.ModuleList(level(dims[s], s, blocks[s]) for s in range(4))
        self.down = nn.ModuleList(
            nn.Sequential(_conv(d, d // 2, 3), nn.PixelUnshuffle(2)) for d in dims[:3]
        )
        self.up = nn.ModuleList(
            nn.Sequential(_conv(d, 2 * d, 3), nn.PixelShuffle(2)) for d in reversed(dims[1:])
        )
        # Skips double the channels; every level but the finest halves them again.
        self.reduce = nn.ModuleList(
            [_conv(2 * dims[2], dims[2], 1), _conv(2 * dims[1], dims[1], 1), nn.Identity()]
        )
        widths = (2 * dims[0], dims[1], dims[2])
        self.decoder = nn.ModuleList(level(widths[s], s, blocks[s]) for s in (2, 1, 0))
        self.refinement = level(2 * dim, 0, refinement)
        self.last = _conv(2 * dim, out_channels, 3)

    def forward(self, x: Tensor) -> Tensor:
        """Run the network on (B, in_channels, H, W)."""
        features = self.encoder[0](self.first(pad_to_multiple(x, 8)))
        skips = []
        for down, encoder in zip(self.down, self.encoder[1:], strict=True):
            skips.append(features)
            features = encoder(down(features))
        for up, reduce, decoder in zip(self.up, self.reduce, self.decoder, strict=True):
            features = decoder(reduce(torch.cat([up(features), skips.pop()], dim=1)))
        correction: Tensor = self.last(self.refinement(features))[..., : x.shape[-2], : x.shape[-1]]
        return x + correction if self.residual else correction


class TransformerBlock(nn.Module):
    """Attention followed by a gated feed-forward network, each with input norm and skip."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.norm_attention = BiasFreeNorm(channels)
        self.attention = TransposedAttention(channels, heads)
        self.norm_feed = BiasFreeNorm(channels)
        self.feed = GatedFeedForward(channels)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        attended: Tensor = x + self.attention(self.norm_attention(x))
        fed: Tensor = attended + self.feed(self.norm_feed(attended))
        return fed


class BiasFreeNorm(nn.Module):
    """Layer norm that divides each pixel's channels by their standard deviation, without bias.

    Bias-free as in Mohan et al., "Robust and Interpretable Blind Image Denoising via Bias-Free
    Convolutional Neural Networks", ICLR 2020: no mean is subtracted, no offset added.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        variance = x.float().var(dim=1, keepdim=True, unbiased=False)
        return x * torch.rsqrt(variance + 1e-5) * self.weight  # 1e-5: PyTorch's LayerNorm


class TransposedAttention(nn.Module):
    """Multi-Dconv head transposed attention (MDTA): per head, attention between channels."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.temperature = nn.Parameter(torch.ones(heads, 1, 1))
        self.project = nn.Sequential(
            _conv(channels, 3 * channels, 1), _conv(3 * channels, 3 * channels, 3, depthwise=True)
        )
        self.out = _conv(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        batch, channels, height, width = x.shape
        split = (batch, 3, self.heads, channels // self.heads, height * width)
        query, key, value = self.project(x).reshape(split).unbind(dim=1)
        # Unit length over all pixels of the image: half precision is too coarse for this sum.
        query, key = F.normalize(query.float(), dim=-1), F.normalize(key.float(), dim=-1)
        agreement = torch.softmax(query @ key.transpose(-2, -1) * self.temperature, dim=-1)
        mixed: Tensor = self.out((agreement.to(value.dtype) @ value).view(x.shape))
        return mixed


class GatedFeedForward(nn.Module):
    """Gated-Dconv feed-forward network (GDFN): GELU of one half gates the other half."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        hidden = int(channels * _EXPANSION)
        self.project = nn.Sequential(
            _conv(channels, 2 * hidden, 1), _conv(2 * hidden, 2 * hidden, 3, depthwise=True)
        )
        self.out = _conv(hidden, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        gate, content = self.project(x).chunk(2, dim=1)
        gated: Tensor = self.out(F.gelu(gate) * content)
        return gated


def _conv(before: int, after: int, size: int, depthwise: bool = False) -> nn.Conv2d:
    groups = before if depthwise else 1
    return nn.Conv2d(before, after, size, padding=size // 2, groups=groups, bias=False)
