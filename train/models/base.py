"""Input and output of every denoising network: millimetres in, a ``Prediction`` out."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import torch
from torch import Tensor, nn

from glsim.denoise.inputs import DEPTH_ALONE, NetworkInputs


class Prediction(NamedTuple):
    """A network's output for a batch of depth maps; each (B, 1, H, W) float32.

    depth_mm: millimetres along the axis, meaningful where the network predicts depth.
    valid_logit: log odds that a pixel has depth; None if the network codes "no depth" as 0 in
        ``depth_mm``, as the networks of the paper do.
    log_sigma: natural logarithm of the standard deviation of ``depth_mm`` in millimetres, or None.
    candidates_mm, choice_logits: (B, K, H, W), from networks that choose between surfaces: depth of
        each surface, and log odds up to a common term. ``depth_mm`` is the likeliest one.
    """

    depth_mm: Tensor
    valid_logit: Tensor | None = None
    log_sigma: Tensor | None = None
    candidates_mm: Tensor | None = None
    choice_logits: Tensor | None = None

    def hard_mm(self) -> Tensor:
        """Depth, with 0 where no depth is the likelier."""
        if self.valid_logit is None:
            return self.depth_mm
        return torch.where(self.valid_logit > 0, self.depth_mm, torch.zeros_like(self.depth_mm))


_Module = TypeVar("_Module", bound=nn.Module)


def channels_last(module: _Module) -> _Module:
    """Store the weights of a network as (N, H, W, C), the faster order for convolutions."""
    return module.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]  # torch's overloads lack it


class DepthModel(nn.Module):
    """A denoiser of depth frames of any size: ``model(noisy_mm) -> Prediction``.

    noisy_mm: (B, C, H, W) float32: the depth to denoise in millimetres, 0 = no return, and, if the
    model has further ``inputs``, those; see ``glsim.denoise.inputs``. Scaling happens inside the
    model, so no caller can feed a wrong range.
    """

    inputs: NetworkInputs = DEPTH_ALONE

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise."""
        raise NotImplementedError
