"""A self-supervised loss: it never sees a clean frame. Limits: docs/rivals.md."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar, Literal

import torch
from pydantic import Field
from torch import Generator, Tensor
from torch.nn import functional

from glsim.train.losses.base import Loss, LossParts, to_float32, weighted_mean
from glsim.train.models.base import Prediction


class Recorrupted(Loss):
    """Recorrupted-to-recorrupted, for Gaussian noise of a known size on the measured pixels.

    Pang, Zheng, Quan, Ji, CVPR 2021, in the form of Monroy, Bacca, Tachella, "Generalized
    Recorrupted-to-Recorrupted", CVPR 2025. With more noise w ~ N(0, sigma), the input y + tau w
    and the target y - w / tau, tau = sqrt(alpha / (1 - alpha)), carry independent noise: the
    squared error against the target is that against the clean depth plus a constant. It assumes
    noise that is independent from pixel to pixel, skips holes and does not train validity.
    """

    can_be_monitored: ClassVar[bool] = False
    depth_alone: ClassVar[bool] = True
    kind: Literal["recorrupted"] = "recorrupted"
    alpha: float = Field(0.15, gt=0, lt=1, description="0.15 as in Monroy et al.")
    sigma_mm: float = Field(1.65, gt=0, description="assumed noise; kinect-v2 at 0.9 m has 1.65")
    beta_mm: float = Field(
        3.0, gt=0, description="error below which depth counts squared, above linearly"
    )

    @property
    def tau(self) -> float:
        """Share of the added noise that goes to the input."""
        return math.sqrt(self.alpha / (1 - self.alpha))

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Return the distance from the measured depth, which validation reports.

        Lower is not better: the identity has 0. clean_mm is ignored.
        """
        total = _depth_loss(prediction, noisy_mm, noisy_mm > 0, self.beta_mm)
        return total, {"measured": total}

    def training_loss(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        generator: Generator,
    ) -> tuple[Tensor, LossParts]:
        """Return the error against the recorrupted target. clean_mm is ignored."""
        added_mm = self.added_noise_mm(noisy_mm, generator)
        prediction = to_float32(model(noisy_mm + self.tau * added_mm))
        # Squared, as the method demands, up to four standard deviations of the target's noise.
        # Larger errors are those of flying pixels, whose squares would dominate the loss.
        reach_mm = 4 * self.sigma_mm * math.hypot(1, 1 / self.tau)
        target_mm = noisy_mm - added_mm / self.tau
        total = _depth_loss(prediction, target_mm, noisy_mm > 0, reach_mm)
        return total * (reach_mm / self.beta_mm) ** 2, {"recorrupted": total}

    def added_noise_mm(self, noisy_mm: Tensor, generator: Generator) -> Tensor:
        """Draw Gaussian noise on the measured pixels, 0 elsewhere; shaped like the depth."""
        noise = torch.randn(noisy_mm.shape, generator=generator).to(noisy_mm.device)
        return torch.where(noisy_mm > 0, self.sigma_mm * noise, 0.0)


def _depth_loss(prediction: Prediction, target_mm: Tensor, mask: Tensor, beta_mm: float) -> Tensor:
    """Smooth L1 in units of beta, averaged over the pixels of the mask."""
    error = (prediction.depth_mm - target_mm) / beta_mm
    per_pixel = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
    return weighted_mean(per_pixel, mask.float())
