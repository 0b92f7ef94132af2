"""Losses. Each is a table of a recipe, [loss], and a callable; all arithmetic is float32.

A loss is called with a prediction, the noisy and the clean depth, each (B, 1, H, W) float32
millimetres with 0 = no depth, and gives the total and its parts by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import log
from typing import Any, Literal

import torch
from pydantic import BaseModel, ConfigDict, Field
from torch import Generator, Tensor
from torch.nn import functional

from glsim.config import validate
from glsim.errors import ConfigError, did_you_mean
from glsim.train.models.base import Prediction

Parts = dict[str, Tensor]


class Loss(BaseModel):
    """What all losses share."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, Parts]:
        """The total, a scalar, and its parts."""
        raise NotImplementedError

    def of_batch(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        draw: Generator,
    ) -> tuple[Tensor, Parts]:
        """The loss of a training step; those that hide or add something do it here.

        draw: the step's own source of random numbers, on the CPU.
        """
        return self(in_float32(model(noisy_mm)), noisy_mm, clean_mm)


class AllPixels(Loss):
    """Mean squared error over all pixels, mm2, as the paper trains: 0 is a depth like any other."""

    kind: Literal["all_pixels"] = "all_pixels"

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, Parts]:
        """The total is the only part. A validity, if predicted, weighs the depth."""
        depth = prediction.depth_mm
        if prediction.valid_logit is not None:
            depth = depth * prediction.valid_logit.sigmoid()
        total = functional.mse_loss(depth, clean_mm)
        return total, {"mse": total}


class Masked(Loss):
    """Depth where there is a clean one and the input has some near; validity everywhere.

    The weights are of experiments with a network of seven layers on synthetic faces: a validity
    weighed 20 against a depth error divided by 10 mm starved the surface, 5 against 3 mm did not.
    """

    kind: Literal["masked"] = "masked"
    depth: Literal["smooth_l1", "gaussian", "laplace"] = Field(
        "smooth_l1", description="gaussian, laplace: likelihood, for networks with log_sigma"
    )
    beta_mm: float = Field(3.0, gt=0, description="errors below are squared, those above are not")
    valid_weight: float = Field(5.0, ge=0, description="of the cross entropy of validity")
    slope_weight: float = Field(
        0.0, ge=0, description="of the error of depth differences between neighbours"
    )
    reach_px: int = Field(12, ge=1, description="depth is asked for so near to a valid pixel")
    jump_mm: float = Field(20.0, gt=0, description="differences above are edges, not slopes")

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, Parts]:
        """Parts: depth, and valid and slope where they weigh anything."""
        there = (clean_mm > 0).float()
        window = 2 * self.reach_px + 1
        near = functional.max_pool2d((noisy_mm > 0).float(), window, 1, self.reach_px)
        asked = there * near
        error = prediction.depth_mm - clean_mm
        parts = {"depth": mean_where(self._depth(error, prediction.log_sigma), asked)}
        total = parts["depth"]
        if self.valid_weight and prediction.valid_logit is not None:
            parts["valid"] = functional.binary_cross_entropy_with_logits(
                prediction.valid_logit, there
            )
            total = total + self.valid_weight * parts["valid"]
        if self.slope_weight:
            parts["slope"] = self._slope(error, clean_mm, asked)
            total = total + self.slope_weight * parts["slope"]
        return total, parts

    def _depth(self, error_mm: Tensor, log_sigma: Tensor | None) -> Tensor:
        """Per pixel. In units of beta, so that all three are of one size."""
        if self.depth == "smooth_l1":
            return functional.smooth_l1_loss(
                error_mm / self.beta_mm, torch.zeros_like(error_mm), reduction="none"
            )
        if log_sigma is None:
            raise ConfigError(
                f"loss.depth = {self.depth!r} needs a network that predicts its uncertainty: set "
                'model.uncertainty = true, or loss.depth = "smooth_l1"'
            )
        share = error_mm * torch.exp(-log_sigma)
        if self.depth == "gaussian":
            return 0.5 * share.square() + log_sigma
        # Laplace with standard deviation sigma: scale sigma / sqrt 2.
        return 2**0.5 * share.abs() + log_sigma + 0.5 * log(2)

    def _slope(self, error_mm: Tensor, clean_mm: Tensor, asked: Tensor) -> Tensor:
        terms = []
        for axis in (-2, -1):
            both = _behind(asked, axis) * _ahead(asked, axis)
            smooth = (_ahead(clean_mm, axis) - _behind(clean_mm, axis)).abs() < self.jump_mm
            step = (_ahead(error_mm, axis) - _behind(error_mm, axis)) / self.beta_mm
            each = functional.smooth_l1_loss(step, torch.zeros_like(step), reduction="none")
            terms.append(mean_where(each, both * smooth))
        return torch.stack(terms).mean()


def losses() -> dict[str, type[Loss]]:
    """What [loss] kind may be."""
    from glsim.train.selfsupervised import Noise2Void, Recorrupted  # they are built on this file

    kinds: list[type[Loss]] = [AllPixels, Masked, Noise2Void, Recorrupted]
    return {kind.model_fields["kind"].default: kind for kind in kinds}


def build_loss(table: Mapping[str, Any]) -> Loss:
    """The loss of a recipe's [loss]. Raises ConfigError for an unknown kind or parameter."""
    kind, known = table.get("kind"), losses()
    if kind not in known:
        raise ConfigError(f"loss: no such kind {kind!r} ({did_you_mean(str(kind), known)})")
    return validate(known[kind], table, "loss")


def in_float32(prediction: Prediction) -> Prediction:
    """What a network in mixed precision may have given in half of it."""
    return Prediction(*(None if part is None else part.float() for part in prediction))


def mean_where(values: Tensor, weights: Tensor) -> Tensor:
    """Over the pixels that count; 0 if there are none."""
    return (values * weights).sum() / weights.sum().clamp_min(1)


def _ahead(image: Tensor, axis: int) -> Tensor:
    return image.narrow(axis, 1, image.shape[axis] - 1)


def _behind(image: Tensor, axis: int) -> Tensor:
    return image.narrow(axis, 0, image.shape[axis] - 1)
