"""Self-supervised losses: they never see a clean frame. Limits: docs/self_supervised.md.

Both assume noise that is independent from pixel to pixel, both skip holes, and neither trains
validity: the output has the mask of the input.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar, Final, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Generator, Tensor
from torch.nn import functional

from glsim.train.losses.base import Loss, LossParts, to_float32, weighted_mean
from glsim.train.models.base import Prediction

#: Number of neighbours drawn before a pixel keeps its depth. Chosen: at a straight silhouette one
#: pixel in a thousand keeps it.
_TRIES: Final = 10


class NoisyTargetLoss(Loss):
    """Base class of losses whose target is the measured depth."""

    can_be_monitored: ClassVar[bool] = False
    depth_alone: ClassVar[bool] = True
    beta_mm: float = Field(
        3.0, gt=0, description="error below which depth counts squared, above linearly"
    )

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Return the distance from the measured depth, which validation reports.

        Lower is not better: the identity has 0. clean_mm is ignored.
        """
        total = self.depth_loss(prediction, noisy_mm, noisy_mm > 0, self.beta_mm)
        return total, {"measured": total}

    @staticmethod
    def depth_loss(
        prediction: Prediction, target_mm: Tensor, mask: Tensor, beta_mm: float
    ) -> Tensor:
        """Smooth L1 in units of beta, averaged over the pixels of the mask."""
        error = (prediction.depth_mm - target_mm) / beta_mm
        per_pixel = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
        return weighted_mean(per_pixel, mask.float())


class Noise2Void(NoisyTargetLoss):
    """The blind spot of Krull, Buchholz, Jug, "Noise2Void", CVPR 2019, for maps with holes.

    Some measured pixels are replaced by a measured neighbour; the target is their measured depth,
    whose noise, if independent from pixel to pixel, cannot be predicted from the surroundings.
    """

    kind: Literal["noise2void"] = "noise2void"
    share: float = Field(
        0.0156, gt=0, lt=1, description="share of pixels replaced; the paper's 64 of 64 x 64"
    )
    radius_px: int = Field(
        2, ge=1, description="half side of the square that replacements come from"
    )

    def training_loss(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        generator: Generator,
    ) -> tuple[Tensor, LossParts]:
        """Return the error at the blind spots. clean_mm is ignored."""
        spots = blind_spots(noisy_mm, self.share, self.radius_px, generator)
        prediction = to_float32(model(spots.noisy_mm))
        total = self.depth_loss(prediction, noisy_mm, spots.mask, self.beta_mm)
        return total, {"hidden": total}


class BlindSpots(NamedTuple):
    """Depth maps (B, 1, H, W) with some pixels replaced, and the bool mask of these."""

    noisy_mm: Tensor
    mask: Tensor


def blind_spots(noisy_mm: Tensor, share: float, radius_px: int, generator: Generator) -> BlindSpots:
    """Replace a share of the measured pixels by random measured neighbours.

    A pixel never replaces itself. One without measured neighbours keeps its depth and is not in
    the mask.
    """
    size = 2 * radius_px + 1
    chosen = torch.rand(noisy_mm.shape, generator=generator).to(noisy_mm.device) < share
    image, _, row, column = torch.nonzero(chosen & (noisy_mm > 0), as_tuple=True)
    # Index of a neighbour in the square, row by row, without its centre.
    offset = torch.randint(size * size - 1, (len(image), _TRIES), generator=generator)
    offset = offset.to(noisy_mm.device)
    offset = offset + (offset >= size * size // 2)
    padded = functional.pad(noisy_mm, (radius_px,) * 4)[:, 0]
    near_mm = padded[image[:, None], row[:, None] + offset // size, column[:, None] + offset % size]
    first = (near_mm > 0).float().argmax(dim=1, keepdim=True)
    value_mm = near_mm.gather(1, first)[:, 0]
    measured = value_mm > 0
    places = (
        image[measured],
        torch.zeros_like(image[measured]),
        row[measured],
        column[measured],
    )
    replaced_mm, mask = noisy_mm.clone(), torch.zeros_like(noisy_mm, dtype=torch.bool)
    replaced_mm[places], mask[places] = value_mm[measured], True
    return BlindSpots(replaced_mm, mask)


class Recorrupted(NoisyTargetLoss):
    """Recorrupted-to-recorrupted, for Gaussian noise of a known size on the measured pixels.

    Pang, Zheng, Quan, Ji, CVPR 2021, in the form of Monroy, Bacca, Tachella, "Generalized
    Recorrupted-to-Recorrupted", CVPR 2025. With more noise w ~ N(0, sigma), the input y + tau w
    and the target y - w / tau, tau = sqrt(alpha / (1 - alpha)), carry independent noise: the
    squared error against the target is that against the clean depth plus a constant.
    """

    kind: Literal["recorrupted"] = "recorrupted"
    alpha: float = Field(0.15, gt=0, lt=1, description="0.15 as in Monroy et al.")
    sigma_mm: float = Field(1.65, gt=0, description="assumed noise; kinect-v2 at 0.9 m has 1.65")

    @property
    def tau(self) -> float:
        """Share of the added noise that goes to the input."""
        return math.sqrt(self.alpha / (1 - self.alpha))

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
        total = self.depth_loss(prediction, target_mm, noisy_mm > 0, reach_mm)
        return total * (reach_mm / self.beta_mm) ** 2, {"recorrupted": total}

    def added_noise_mm(self, noisy_mm: Tensor, generator: Generator) -> Tensor:
        """Gaussian noise on the measured pixels, 0 elsewhere; shaped like the depth."""
        noise = torch.randn(noisy_mm.shape, generator=generator).to(noisy_mm.device)
        return torch.where(noisy_mm > 0, self.sigma_mm * noise, 0.0)
