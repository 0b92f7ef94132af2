"""Base class of all backbones, and helpers that several backbones use."""

from __future__ import annotations

from typing import Annotated

import torch.nn.functional as F  # noqa: N812 (its usual name)
from pydantic import Field
from torch import Tensor, nn

from glsim.core.errors import ConfigError
from glsim.networks.record import AROUND_PX

#: Bounds of sizes in a recipe or checkpoint, checked before a network is built. They are several
#: times the largest published sizes (Restormer: 384 channels, 8 blocks; DnCNN: 64 layers).
Width = Annotated[int, Field(ge=1, le=4096)]
Depth = Annotated[int, Field(ge=2, le=512)]
Blocks = Annotated[int, Field(ge=1, le=64)]
Scales = Annotated[int, Field(ge=2, le=8)]


class Backbone(nn.Module):
    """A network from (B, in_channels, H, W) to (B, out_channels, H, W), for any H and W.

    It has no units: a `DepthModel` wraps it and converts millimetres. With ``residual`` it adds its
    input to the output of its layers; raises ConfigError if their channels differ. Its last layer
    is created last. Holes farther than ``margin_px`` from a pixel with depth do not influence it.
    """

    margin_px: int = AROUND_PX

    def __init__(self, in_channels: int, out_channels: int, residual: bool) -> None:
        super().__init__()
        if residual and in_channels != out_channels:
            raise ConfigError(
                f"{type(self).__name__}: a residual needs as many channels in ({in_channels}) as "
                f"out ({out_channels}); set residual = false"
            )
        self.residual = residual

    def forward(self, x: Tensor) -> Tensor:
        """Run the network on (B, in_channels, H, W)."""
        raise NotImplementedError


def pad_to_multiple(x: Tensor, multiple: int) -> Tensor:
    """Replicate the right and lower edge of (B, C, H, W) until H and W are multiples of a number.

    The upper left corner stays, so that crops at multiples have the same grid.
    """
    height, width = x.shape[-2:]
    below, right = -height % multiple, -width % multiple
    return F.pad(x, (0, right, 0, below), mode="replicate") if below or right else x


def init_he(layer: nn.Conv2d) -> None:
    """Draw the weights of a convolution after He et al., ICCV 2015, and set its bias to 0."""
    nn.init.kaiming_normal_(layer.weight, mode="fan_in")
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)


def init_zero(layer: nn.Conv2d) -> None:
    """Set weights and bias of a convolution to 0, so that it outputs 0 before training."""
    nn.init.zeros_(layer.weight)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
