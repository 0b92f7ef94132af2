"""U-Net of the size in the paper's table.

O. Ronneberger, P. Fischer, T. Brox, "U-Net: Convolutional Networks for Biomedical Image
Segmentation", MICCAI 2015, with padded convolutions, nearest-neighbour upsampling followed by a
convolution, and a residual, as in image restoration libraries.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from glsim.train.models.backbone import Backbone, Scales, Width, pad_to_multiple


class UNet(Backbone):
    """U-Net with two 3x3 convolutions per scale and doubled width; skips are concatenated.

    (B, in_channels, H, W) to (B, out_channels, H, W); sizes that 2^(scales - 1) does not divide are
    padded inside. Parameters at 1 -> 1: 8,562,881.
    """

    def __init__(
        self, in_channels: Width = 1, out_channels: Width = 1, scales: Scales = 4,
        width: Width = 64, residual: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(in_channels, out_channels, residual)
        widths = [width * 2**scale for scale in range(scales)]
        self.down = nn.ModuleList(
            _pair(before, after)
            for before, after in zip([in_channels, *widths], widths, strict=False)
        )
        finer = list(reversed(widths[:-1]))
        self.up = nn.ModuleList(
            nn.Sequential(nn.Upsample(scale_factor=2), *_layer(2 * after, after)) for after in finer
        )
        self.merge = nn.ModuleList(_pair(2 * after, after) for after in finer)
        self.last = nn.Conv2d(width, out_channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Run the network on (B, in_channels, H, W)."""
        features = self.down[0](pad_to_multiple(x, 2 ** (len(self.down) - 1)))
        skips = []
        for down in self.down[1:]:
            skips.append(features)
            features = down(nn.functional.max_pool2d(features, 2))
        for up, merge in zip(self.up, self.merge, strict=True):
            features = merge(torch.cat([skips.pop(), up(features)], dim=1))
        correction: Tensor = self.last(features)[..., : x.shape[-2], : x.shape[-1]]
        return x + correction if self.residual else correction


def _pair(before: int, after: int) -> nn.Sequential:
    return nn.Sequential(*_layer(before, after), *_layer(after, after))


def _layer(before: int, after: int) -> list[nn.Module]:
    return [nn.Conv2d(before, after, 3, padding=1), nn.BatchNorm2d(after), nn.ReLU()]
