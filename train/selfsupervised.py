"""Losses that never see a clean frame, made to know holes; limits: docs/self_supervised.md.

Both are denoising by the noise's independence, and so learn nothing of validity: which pixels have
depth is left as it was measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar, Final, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Generator, Tensor
from torch.nn import functional

from glsim.train.losses import Loss, Parts, in_float32, mean_where
from glsim.train.models.base import Prediction

#: Draws of a neighbour before a pixel is left as it is: one in a thousand pixels at a straight
#: silhouette, where half of the neighbours are holes, stays unhidden.
_TRIES: Final = 10


class _AgainstNoisy(Loss):
    """Compares with the measurement itself, where there is one."""

    judges: ClassVar[bool] = False
    beta_mm: float = Field(3.0, gt=0, description="errors below are squared, those above are not")

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, Parts]:
        """What a validation reports: how far the depth is from the measured one. Lower is not
        better, the identity has 0; clean_mm is not looked at.
        """
        total = self.depth(prediction, noisy_mm, noisy_mm > 0, self.beta_mm)
        return total, {"measured": total}

    @staticmethod
    def depth(prediction: Prediction, target_mm: Tensor, where: Tensor, beta_mm: float) -> Tensor:
        """Smooth L1 in units of beta, over the pixels ``where``."""
        error = (prediction.depth_mm - target_mm) / beta_mm
        each = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
        return mean_where(each, where.float())


class Noise2Void(_AgainstNoisy):
    """The blind spot of Krull, Buchholz, Jug, "Noise2Void", CVPR 2019, for maps with holes.

    Some measured pixels are replaced by a measured one near by, and the network is asked for what
    they were. It can know by its surroundings alone, so that noise which is independent from
    pixel to pixel cannot be learned.
    """

    kind: Literal["noise2void"] = "noise2void"
    share: float = Field(
        0.0156, gt=0, lt=1, description="of the pixels that are hidden; the paper's 64 of 64 x 64"
    )
    radius_px: int = Field(2, ge=1, description="of the square that a replacement comes from")

    def of_batch(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        draw: Generator,
    ) -> tuple[Tensor, Parts]:
        """Error at the hidden pixels. clean_mm is not looked at."""
        hidden = hide(noisy_mm, self.share, self.radius_px, draw)
        prediction = in_float32(model(hidden.noisy_mm))
        total = self.depth(prediction, noisy_mm, hidden.where, self.beta_mm)
        return total, {"hidden": total}


class Hidden(NamedTuple):
    """Depth maps (B, 1, H, W) with replaced pixels, and bool where these are."""

    noisy_mm: Tensor
    where: Tensor


def hide(noisy_mm: Tensor, share: float, radius_px: int, draw: Generator) -> Hidden:
    """Replace a share of the measured pixels by random measured ones of their neighbourhood.

    A pixel is never replaced by itself; one without measured neighbours stays, and is not among
    ``where``.
    """
    size = 2 * radius_px + 1
    chosen = torch.rand(noisy_mm.shape, generator=draw).to(noisy_mm.device) < share
    image, _, row, column = torch.nonzero(chosen & (noisy_mm > 0), as_tuple=True)
    # Places of the square but for its middle, numbered row by row.
    step = torch.randint(size * size - 1, (len(image), _TRIES), generator=draw).to(noisy_mm.device)
    step = step + (step >= size * size // 2)
    padded = functional.pad(noisy_mm, (radius_px,) * 4)[:, 0]
    near_mm = padded[image[:, None], row[:, None] + step // size, column[:, None] + step % size]
    first = (near_mm > 0).float().argmax(dim=1, keepdim=True)
    value_mm = near_mm.gather(1, first)[:, 0]
    found = value_mm > 0
    place = (image[found], torch.zeros_like(image[found]), row[found], column[found])
    replaced, where = noisy_mm.clone(), torch.zeros_like(noisy_mm, dtype=torch.bool)
    replaced[place], where[place] = value_mm[found], True
    return Hidden(replaced, where)


class Recorrupted(_AgainstNoisy):
    """Recorrupted to recorrupted, for Gaussian noise of a known size on the measured pixels.

    Pang, Zheng, Quan, Ji, CVPR 2021, in the form of Monroy, Bacca, Tachella, "Generalized
    Recorrupted-to-Recorrupted", CVPR 2025: with more noise w ~ N(0, sigma), input y + tau w and
    target y - w / tau, tau = sqrt(alpha / (1 - alpha)), carry independent noise, so that the
    squared error against the target is that against the clean depth plus a constant.
    """

    kind: Literal["recorrupted"] = "recorrupted"
    alpha: float = Field(0.15, gt=0, lt=1, description="0.15 is that of Monroy et al.")
    sigma_mm: float = Field(
        1.65, gt=0, description="of the noise that is assumed; kinect-v2 at 0.9 m has 1.65"
    )

    @property
    def tau(self) -> float:
        """How much of the added noise goes to the input."""
        return math.sqrt(self.alpha / (1 - self.alpha))

    def of_batch(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        draw: Generator,
    ) -> tuple[Tensor, Parts]:
        """Error against the second of the two. clean_mm is not looked at."""
        added_mm = self.added_mm(noisy_mm, draw)
        prediction = in_float32(model(noisy_mm + self.tau * added_mm))
        # Squared, as the method demands, for whatever the target's own noise may be: four of its
        # standard deviations. Beyond lie flying pixels, whose squares would drown all others.
        reach_mm = 4 * self.sigma_mm * math.hypot(1, 1 / self.tau)
        total = self.depth(prediction, noisy_mm - added_mm / self.tau, noisy_mm > 0, reach_mm)
        return total * (reach_mm / self.beta_mm) ** 2, {"recorrupted": total}

    def added_mm(self, noisy_mm: Tensor, draw: Generator) -> Tensor:
        """Noise on the measured pixels, 0 elsewhere."""
        noise = torch.randn(noisy_mm.shape, generator=draw).to(noisy_mm.device)
        return torch.where(noisy_mm > 0, self.sigma_mm * noise, 0.0)
