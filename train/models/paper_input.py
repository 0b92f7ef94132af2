"""The paper's network input: raw millimetres, in which 0 is a depth like any other."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from glsim.train.models.backbone import Backbone
from glsim.train.models.base import DepthModel, Prediction


class PaperInput(DepthModel):
    """Millimetres in, millimetres out, as in the rows of the paper's tables.

    noisy_mm: (B, 1, H, W) float32. The prediction has no ``valid_logit``: the network must express
    "no return" as a depth of 0, and so places pixels in mid-air at silhouettes. bfloat16 rounds
    900 mm to 4 mm: train these rows in float32.
    """

    def __init__(self, backbone: Backbone) -> None:
        super().__init__()
        self.backbone = backbone

    @staticmethod
    def backbone_settings() -> dict[str, Any]:
        """Arguments that the backbone must be built with."""
        return {"in_channels": 1, "out_channels": 1}

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise."""
        return Prediction(self.backbone(noisy_mm, (noisy_mm > 0).to(noisy_mm.dtype)).float())
