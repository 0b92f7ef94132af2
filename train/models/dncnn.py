"""DnCNN, a plain stack of 3x3 convolutions that predicts a correction of the image.

K. Zhang, W. Zuo, Y. Chen, D. Meng, L. Zhang, "Beyond a Gaussian Denoiser: Residual Learning of
Deep CNN for Image Denoising", IEEE TIP 26(7), 2017, in the variant without batch normalisation
that image restoration libraries (deepinv) ship.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from glsim.train.models.backbone import Backbone, Depth, Width


class DnCNN(Backbone):
    """DnCNN with ``depth`` 3x3 convolutions of ``width`` channels, ReLU, biases, no normalisation.

    (B, in_channels, H, W) to (B, out_channels, H, W). Parameters at 1 -> 1 and width 64: depth 7
    185,857; depth 20 665,921; depth 64 2,290,753. A pixel sees ``depth`` pixels to each side.
    """

    def __init__(
        self, in_channels: Width = 1, out_channels: Width = 1, depth: Depth = 20, width: Width = 64,
        residual: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(in_channels, out_channels, residual)
        ends = [in_channels, *[width] * (depth - 1), out_channels]
        layers = [nn.Conv2d(ends[i], ends[i + 1], 3, padding=1) for i in range(depth)]
        for layer in layers:
            nn.init.kaiming_normal_(layer.weight, mode="fan_in")
        self.layers = nn.ModuleList(layers)

    def forward(self, x: Tensor) -> Tensor:
        """Run the network on (B, in_channels, H, W)."""
        features = x
        for layer in self.layers[:-1]:
            features = torch.relu(layer(features))
        correction: Tensor = self.layers[-1](features)
        return x + correction if self.residual else correction
