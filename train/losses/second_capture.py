"""Losses whose target is a second noisy capture: no clean frame is seen. See docs/rivals.md.

J. Lehtinen et al., "Noise2Noise: Learning Image Restoration without Clean Data", ICML 2018: the
noise of a second capture cannot be predicted from the first, so the best prediction is the surface
that both share. Consecutive frames are such captures; pixels that moved are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal

import torch
from pydantic import Field
from torch import Generator, Tensor
from torch.nn import functional

from glsim.train.interior_mask import dilated
from glsim.train.losses.base import LossParts, to_float32, weighted_mean
from glsim.train.losses.self_supervised import NoisyTargetLoss
from glsim.train.losses.surface_priors import inverse_huber, normal_smoothness
from glsim.train.models.base import Prediction

#: Half side of the window that compares two captures, px. Derived: the mean of 49 differences of
#: 2.3 mm (kinect-v2 at 0.9 m) has a standard deviation of 0.3 mm.
_WINDOW_PX: Final = 3
#: Clipping of a difference, in units of ``moved_mm``: one flying pixel must not look like motion.
_LARGEST_DIFFERENCE: Final = 4.0


class SecondCaptureLoss(NoisyTargetLoss):
    """Base class of losses whose batches hold a second capture in place of the clean frame."""

    frames_apart: int = Field(
        1, ge=1, description="the second capture is up to this many frames before or after"
    )
    moved_mm: float = Field(
        2.0, ge=0, description="mean difference in 7 x 7 px that counts as motion; 0: all is still"
    )

    def training_loss(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        generator: Generator,
    ) -> tuple[Tensor, LossParts]:
        """Return ``capture_loss``; a batch has the second capture in place of clean_mm."""
        return self.capture_loss(to_float32(model(noisy_mm)), noisy_mm, clean_mm)

    def capture_loss(
        self, prediction: Prediction, noisy_mm: Tensor, second_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Compare a prediction with the second capture; return the total and its parts.

        noisy_mm, second_mm: (B, 1, H, W) float32 millimetres, 0 = no return.
        """
        raise NotImplementedError


class Noise2Noise(SecondCaptureLoss):
    """The measured depth of a second capture, for networks with or without a validity.

    Holes near measured pixels have a target where the second capture has depth. With
    ``valid_weight``, a predicted validity learns the probability that the sensor measures a pixel.
    """

    kind: Literal["noise2noise"] = "noise2noise"
    reach_px: int = Field(
        4, ge=0, description="largest distance of a target from a measured pixel of the input"
    )
    valid_weight: float = Field(
        0.0, ge=0, description="weight of the cross entropy against the second capture's mask"
    )

    def capture_loss(
        self, prediction: Prediction, noisy_mm: Tensor, second_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Return the error of still pixels, and that of the validity if it has a weight."""
        still = still_pixels(noisy_mm, second_mm, self.moved_mm)
        # A network without a validity codes a hole as a depth of 0, which is no estimate.
        reach_px = self.reach_px if prediction.valid_logit is not None else 0
        mask = (second_mm > 0) & still & dilated(noisy_mm > 0, reach_px)
        parts = {"second": self.depth_loss(prediction, second_mm, mask, self.beta_mm)}
        total = parts["second"]
        if self.valid_weight and prediction.valid_logit is not None:
            entropy = functional.binary_cross_entropy_with_logits(
                prediction.valid_logit, (second_mm > 0).float(), reduction="none"
            )
            parts["valid"] = weighted_mean(entropy, still.float())
            total = total + self.valid_weight * parts["valid"]
        return total, parts


class MultiView(SecondCaptureLoss):
    """The objective of Sterzentsenko et al. with a second capture in place of registered views.

    V. Sterzentsenko et al., "Self-Supervised Deep Depth Denoising", ICCV 2019: the denoised map of
    one sensor is rendered into the registered views of others and compared there in colour; an
    inverse Huber distance to the measured depth and a prior of smooth normals regularise it. One
    sensor has no other view and no colour that depends on depth: the first term is here the
    distance from a second capture. The weights of the three terms are the authors'; their units
    differ (ours: beta_mm, metres, 1 - cosine).
    """

    kind: Literal["multi_view"] = "multi_view"
    capture_weight: float = Field(0.85, ge=0, description="weight of the second capture")
    input_weight: float = Field(0.1, ge=0, description="weight of the distance from the input")
    smooth_weight: float = Field(0.05, ge=0, description="weight of the prior of smooth normals")
    focal_px: float = Field(
        365.456, gt=0, description="focal length, for normals; default: Kinect V2's"
    )

    def capture_loss(
        self, prediction: Prediction, noisy_mm: Tensor, second_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Return the weighted sum of the three terms."""
        measured = noisy_mm > 0
        target = measured & (second_mm > 0) & still_pixels(noisy_mm, second_mm, self.moved_mm)
        parts = {
            "second": self.depth_loss(prediction, second_mm, target, self.beta_mm),
            "input": inverse_huber((prediction.depth_mm - noisy_mm) / 1000.0, measured),
            "smooth": normal_smoothness(prediction.depth_mm, measured, self.focal_px),
        }
        weights = (self.capture_weight, self.input_weight, self.smooth_weight)
        total = torch.stack(
            [weight * part for weight, part in zip(weights, parts.values(), strict=True)]
        ).sum()
        return total, parts


def still_pixels(first_mm: Tensor, second_mm: Tensor, moved_mm: float) -> Tensor:
    """Mark where two (B, 1, H, W) captures differ by no more than noise does; bool.

    The difference is averaged over the pixels of a 7 x 7 window that have depth in both captures:
    noise averages out, motion does not. A window that is empty in both is still, one that is empty
    in one of them has moved.

    Args:
        first_mm: (B, 1, H, W), 0 = no return.
        second_mm: (B, 1, H, W) of the same camera.
        moved_mm: largest mean difference of a still pixel; 0 marks every pixel.
    """
    if not moved_mm:
        return torch.ones_like(first_mm, dtype=torch.bool)
    first, second = first_mm > 0, second_mm > 0
    limit_mm = _LARGEST_DIFFERENCE * moved_mm
    difference_mm = (second_mm - first_mm).clamp(-limit_mm, limit_mm)
    both = (first & second).float()
    share = _mean_of_window(both)
    mean_mm = _mean_of_window(difference_mm * both) / share.clamp_min(1e-6)
    unseen = ~dilated(first | second, _WINDOW_PX)
    # Half a pixel's share: sums of 0 and 1 are exact, so that anything above is a pixel.
    seen_by_both = share > 0.5 / (2 * _WINDOW_PX + 1) ** 2
    return unseen | (seen_by_both & (mean_mm.abs() <= moved_mm))


def _mean_of_window(image: Tensor) -> Tensor:
    """Mean over 7 x 7 px; pixels beyond the image count as 0."""
    return functional.avg_pool2d(image, 2 * _WINDOW_PX + 1, stride=1, padding=_WINDOW_PX)
