"""Depth and its mask into a network, depth with the same mask out of it."""

from __future__ import annotations

from typing import Any, Final

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from glsim.train.models.backbone import Backbone
from glsim.train.models.base import DepthModel, Prediction

#: A network input or output of 1, mm: noise of a time-of-flight camera at 0.9 m is 1-2 mm.
_SCALE_MM: Final = 10.0
#: Half side of the square whose mean the depth is relative to, px: half of a nose at 0.9 m.
_AROUND_PX: Final = 6
#: Largest input: a pixel 100 mm off its surroundings is on another surface, however far that is.
_LARGEST: Final = 10.0


class MaskedDepth(DepthModel):
    """A backbone of one channel that corrects the measured pixels and keeps their mask.

    Holes (values not above 0) stay holes: 0 in the prediction, which has no ``valid_logit``. The
    backbone sees depth relative to the mean of the measured pixels within 13 x 13 px, in units of
    10 mm, and returns a correction in the same units, 0 before training. Meant for networks that
    take the mask, such as `PartialAutoencoder`; others see holes at their surroundings' depth.
    """

    def __init__(self, backbone: Backbone) -> None:
        super().__init__()
        self.backbone = backbone

    @staticmethod
    def backbone_settings() -> dict[str, Any]:
        """Arguments that the backbone must be built with."""
        return {"in_channels": 1, "out_channels": 1, "residual": False, "zero_last": True}

    def forward(self, noisy_mm: Tensor) -> Prediction:
        """Denoise."""
        with torch.autocast(noisy_mm.device.type, enabled=False):
            measured = noisy_mm > 0
            valid = measured.float()
            depth_mm = torch.where(measured, noisy_mm.float(), 0.0)
            offset = (depth_mm - _mean_around(depth_mm, valid)) / _SCALE_MM
            relative = torch.where(measured, offset.clamp(-_LARGEST, _LARGEST), 0.0)
        correction_mm = _SCALE_MM * self.backbone(relative, valid).float()
        return Prediction(torch.where(measured, depth_mm + correction_mm, 0.0))


def _mean_around(depth_mm: Tensor, valid: Tensor) -> Tensor:
    """Mean depth of the valid pixels in a square around each; 0 without any."""
    side = 2 * _AROUND_PX + 1
    # Both sums are means over the whole window; their ratio is that over its valid pixels.
    total, share = (
        F.avg_pool2d(part, side, stride=1, padding=_AROUND_PX) for part in (depth_mm, valid)
    )
    return total / share.clamp_min(0.5 / side**2)
