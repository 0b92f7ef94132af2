"""Input and output of every denoising network: millimetres in, a ``Prediction`` out."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import torch
from torch import Tensor, nn

from glsim.denoise.inputs import DEPTH_ALONE, NetworkInputs
from glsim.denoise.record import AROUND_PX, UNLIKELY


class Prediction(NamedTuple):
    """Output of a network for a batch of depth maps, float32.

    Attributes:
        depth_mm: (B, 1, H, W) millimetres along the axis, defined where the pixel is valid.
        valid_logit: (B, 1, H, W) log odds of depth; None if the network codes "no depth" as 0 in
            ``depth_mm``, as those of the paper do.
        log_sigma: (B, 1, H, W) natural logarithm of the standard deviation of ``depth_mm``, mm.
        candidates_mm: (B, K, H, W) depth of each surface, from networks that choose between
            surfaces; ``depth_mm`` is the likeliest one.
        choice_logits: (B, K, H, W) logits of that choice.
    """

    depth_mm: Tensor
    valid_logit: Tensor | None = None
    log_sigma: Tensor | None = None
    candidates_mm: Tensor | None = None
    choice_logits: Tensor | None = None

    def hard_mm(self) -> Tensor:
        """Return the depth, with 0 where the pixel is predicted invalid."""
        if self.valid_logit is None:
            return self.depth_mm
        return torch.where(self.valid_logit > 0, self.depth_mm, torch.zeros_like(self.depth_mm))


_Module = TypeVar("_Module", bound=nn.Module)


def channels_last(module: _Module) -> _Module:
    """Store the weights of a network as (N, H, W, C), the faster order for convolutions."""
    return module.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]  # torch's overloads lack it


class DepthModel(nn.Module):
    """A denoiser of depth frames of any size: ``model(noisy_mm) -> Prediction``.

    The input is (B, C, H, W) float32: depth in millimetres, 0 = no return, and the model's further
    ``inputs`` (see ``glsim.denoise.inputs``). The model scales them. ``keep_clean``,
    ``margin_px`` and ``unlikely`` are those of its ``glsim.denoise.record.NetworkRecord``.
    """

    inputs: NetworkInputs = DEPTH_ALONE
    keep_clean: bool = True
    margin_px: int = AROUND_PX
    unlikely: float = UNLIKELY

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise."""
        raise NotImplementedError
