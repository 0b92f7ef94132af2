"""Base classes of the denoising networks, from millimetres to a ``Prediction``."""

from __future__ import annotations

from typing import Any, Final, NamedTuple, TypeVar

import torch
from torch import Tensor, nn

from glsim.networks.inputs import DEPTH_ALONE, NetworkInputs
from glsim.networks.record import AROUND_PX
from glsim.train.models.backbone import Backbone


class Prediction(NamedTuple):
    """Output of a network for a batch of depth maps, in float32.

    Attributes:
        depth_mm: (B, 1, H, W) millimetres along the axis, defined where the pixel is valid.
        valid_logit: (B, 1, H, W) log odds of depth; None if "no depth" is a depth of 0.
        log_sigma: (B, 1, H, W) natural logarithm of the standard deviation of ``depth_mm``, mm.
        candidates_mm: (B, K, H, W) depth of each surface, if the network chooses; else None.
        choice_logits: (B, K, H, W) logits of the choice.
    """

    depth_mm: Tensor
    valid_logit: Tensor | None = None
    log_sigma: Tensor | None = None
    candidates_mm: Tensor | None = None
    choice_logits: Tensor | None = None

    def hard_mm(self) -> Tensor:
        """Return the depth, mm, with 0 at pixels that are predicted invalid."""
        if self.valid_logit is None:
            return self.depth_mm
        return torch.where(self.valid_logit > 0, self.depth_mm, torch.zeros_like(self.depth_mm))


_Module = TypeVar("_Module", bound=nn.Module)


def channels_last(module: _Module) -> _Module:
    """Store the weights of a network as (N, H, W, C), which makes convolutions faster."""
    return module.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]  # torch's overloads lack it


class DepthModel(nn.Module):
    """A denoiser of depth frames of any size: ``model(noisy_mm) -> Prediction``.

    The input is (B, C, H, W) float32, unscaled: depth in millimetres, 0 = no return, and the
    further ``inputs`` (see ``glsim.networks.inputs``). ``glsim.networks.record.NetworkRecord``
    explains ``keep_clean`` and ``margin_px``.
    """

    inputs: NetworkInputs = DEPTH_ALONE
    keep_clean: bool = True
    margin_px: int = AROUND_PX

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise a batch, (B, C, H, W) float32."""
        raise NotImplementedError


class PaperInput(DepthModel):
    """A denoiser that feeds millimetres to its backbone unscaled, as in the paper's tables.

    noisy_mm: (B, 1, H, W) float32. The prediction has no ``valid_logit``: the network must express
    "no return" as a depth of 0, and so places pixels in mid-air at silhouettes. bfloat16 rounds
    900 mm to 4 mm: train these rows in float32.
    """

    def __init__(self, backbone: Backbone) -> None:
        super().__init__()
        self.backbone = backbone

    @staticmethod
    def backbone_settings() -> dict[str, Any]:
        """Return the arguments of the backbone that the model sets."""
        return {"in_channels": 1, "out_channels": 1}

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise (B, 1, H, W) millimetres."""
        return Prediction(self.backbone(noisy_mm).float())


#: Names of all outputs, see ``named_outputs``; every network has the first.
OUTPUTS: Final = ("depth_mm", "probability", "sigma_mm", "choice", "risk_mm")


def named_outputs(prediction: Prediction) -> dict[str, Tensor]:
    """Return the outputs of a network by name, (B, 1, H, W) each, in the order of OUTPUTS.

    depth_mm: depth on the chosen surface. probability: probability that the pixel has depth.
    sigma_mm: standard deviation of the depth. choice: probability of the chosen surface. risk_mm:
    expected distance between the true and the chosen surface.
    """
    outputs = {"depth_mm": prediction.depth_mm}
    if prediction.valid_logit is not None:
        outputs["probability"] = prediction.valid_logit.sigmoid()
    if prediction.log_sigma is not None:
        outputs["sigma_mm"] = prediction.log_sigma.exp()
    if prediction.choice_logits is not None and prediction.candidates_mm is not None:
        share = prediction.choice_logits.softmax(dim=1)
        off_mm = (prediction.candidates_mm - prediction.depth_mm).abs()
        outputs["choice"] = share.amax(dim=1, keepdim=True)
        outputs["risk_mm"] = (share * off_mm).sum(dim=1, keepdim=True)
    return outputs


class NamedOutputs(nn.Module):
    """Wrap a network: named inputs, (B, images, H, W) each; the outputs are a tuple, as OUTPUTS."""

    def __init__(self, model: DepthModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Denoise the named inputs, (B, images, H, W) each."""
        stack = inputs[0] if len(inputs) == 1 else torch.cat(inputs, dim=1)
        return tuple(named_outputs(self.model(stack)).values())
