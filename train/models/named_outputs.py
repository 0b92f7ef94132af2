"""The outputs of a network by name, as inference and ONNX files use them."""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor, nn

from glsim.train.models.base import DepthModel, Prediction

#: Names of all outputs, see ``named_outputs``; every network has the first.
OUTPUTS: Final = ("depth_mm", "probability", "sigma_mm", "choice", "risk_mm")


def named_outputs(prediction: Prediction) -> dict[str, Tensor]:
    """Return name -> (B, 1, H, W); names of OUTPUTS, without those that the network lacks.

    depth_mm: depth on the chosen surface. probability: of depth. sigma_mm: standard deviation of
    the depth. choice: probability of the chosen surface. risk_mm: expected distance of the true
    surface from the chosen one.
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
    """A network whose result is the tuple of its outputs, in the order of OUTPUTS.

    Its arguments are the inputs of the model by name, (B, images, H, W) each, in their order.
    """

    def __init__(self, model: DepthModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Denoise (B, 1, H, W) millimetres."""
        stack = inputs[0] if len(inputs) == 1 else torch.cat(inputs, dim=1)
        return tuple(named_outputs(self.model(stack)).values())
