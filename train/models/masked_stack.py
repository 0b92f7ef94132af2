"""DnCNN's stack with layers that take the mask of measured pixels."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from glsim.train.models.backbone import Backbone, Depth, Width, init_zero


class MaskedStack(Backbone):
    """``depth`` 3x3 layers of ``width`` channels, ReLU between them; shapes and sizes are DnCNN's.

    (B, in_channels, H, W) and valid (B, 1, H, W) to (B, out_channels, H, W). Subclasses set the
    layer: ``layer(before, after)`` maps (features, confidence) to the same pair. The last layer is
    an ordinary convolution: confidence has spread by then, and a layer that divides by its own
    weights could never leave zero.
    """

    layer: type[nn.Module]

    def __init__(
        self,
        in_channels: Width = 1,
        out_channels: Width = 1,
        depth: Depth = 7,
        width: Width = 64,
        residual: bool = True,
        zero_last: bool = False,
    ) -> None:
        super().__init__(in_channels, out_channels, residual)
        self.layers = nn.ModuleList(
            self.layer(width if i else in_channels, width) for i in range(depth - 1)
        )
        self.last = nn.Conv2d(width, out_channels, 3, padding=1)
        for convolution in (*self.layers, self.last):
            nn.init.kaiming_normal_(convolution.weight, mode="fan_in")
        if zero_last:
            init_zero(self.last)

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """Denoise; without ``valid`` every pixel counts as measured."""
        confidence = torch.ones_like(x[:, :1]) if valid is None else valid.to(x.dtype)
        features = x
        for layer in self.layers:
            features, confidence = layer(features, confidence)
            features = torch.relu(features)
        correction: Tensor = self.last(features)
        return x + correction if self.residual else correction
