"""What the networks proper have in common: channels in, channels out, any size of image."""

from __future__ import annotations

from typing import Annotated

import torch.nn.functional as F  # noqa: N812 (the name that everyone knows it by)
from pydantic import Field
from torch import Tensor, nn

from glsim.errors import ConfigError

Count = Annotated[int, Field(ge=1)]


class Backbone(nn.Module):
    """A network from (B, in_channels, H, W) to (B, out_channels, H, W), for any H and W.

    It knows nothing of millimetres: a `DepthModel` stands around it. With ``residual`` it adds
    its input to what its layers give; raises ConfigError where the two do not fit.
    """

    def __init__(self, in_channels: int, out_channels: int, residual: bool) -> None:
        super().__init__()
        if residual and in_channels != out_channels:
            raise ConfigError(
                f"{type(self).__name__}: {in_channels} channels in and {out_channels} out leave no "
                "residual to add; set residual = false"
            )
        self.in_channels = in_channels
        self.out_channels = out_channels
        self.residual = residual

    def forward(self, x: Tensor, valid: Tensor | None = None) -> Tensor:
        """The network. valid: (B, 1, H, W), 1 = measured; image networks take no notice of it."""
        raise NotImplementedError


def pad_to_multiple(x: Tensor, multiple: int) -> Tensor:
    """The image (B, C, H, W) with its right and lower edge repeated up to multiples of a number.

    The upper left corner stays where it is, so that a crop at a multiple meets the same grid.
    """
    height, width = x.shape[-2:]
    below, right = -height % multiple, -width % multiple
    return F.pad(x, (0, right, 0, below), mode="replicate") if below or right else x


def zero(layer: nn.Conv2d) -> None:
    """Make a convolution give 0 until it has learned something."""
    nn.init.zeros_(layer.weight)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
