"""The paper's way to feed a network: raw millimetres, in which 0 is a depth like any other."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from .backbone import Backbone
from .base import DepthModel, Prediction


class PaperInput(DepthModel):
    """Millimetres in, millimetres out, as the faithful rows of the paper's tables need it.

    noisy_mm: (B, 1, H, W) float32. The prediction has no ``valid_logit``: the network has to
    express "no return" as a depth of 0, which is what makes it place pixels in mid-air at
    silhouettes. Half precision rounds 900 mm to 4 mm (bfloat16): train these rows in float32.
    """

    def __init__(self, backbone: Backbone) -> None:
        super().__init__()
        self.backbone = backbone

    @staticmethod
    def backbone_settings() -> dict[str, Any]:
        """What the backbone has to be built with."""
        return {"in_channels": 1, "out_channels": 1}

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise."""
        return Prediction(self.backbone(noisy_mm, (noisy_mm > 0).to(noisy_mm.dtype)).float())
