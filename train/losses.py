"""Losses. Each is a table of a recipe, [loss], and a callable; all arithmetic is float32.

A loss is called with a prediction, the noisy and the clean depth, each (B, 1, H, W) float32
millimetres with 0 = no depth, and gives the total and its parts by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import log
from typing import Any, ClassVar, Final, Literal

import torch
from pydantic import BaseModel, ConfigDict, Field
from torch import Generator, Tensor
from torch.nn import functional

from glsim.errors import ConfigError, did_you_mean
from glsim.toml import validate
from glsim.train.caution import REACH_PX
from glsim.train.interior import grown, interior
from glsim.train.models.base import Prediction

Parts = dict[str, Tensor]

#: Several times the noise, and half of what makes a flying pixel.
_ANOTHER_MM: Final = 25.0


class Loss(BaseModel):
    """What all losses share."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    #: Whether lower is better on frames of a validation, so that it may be monitored.
    judges: ClassVar[bool] = True

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

    The weights were found by experiment with `small_unet` on procedural faces under kinect-v2.
    Without the slopes the surface stays rough (normals 11 degrees off after 1,000 steps of 8
    frames, 6 with them); rims that weigh as much as the rest take most of the gradient, for errors
    that no network can know.
    """

    kind: Literal["masked"] = "masked"
    depth: Literal["smooth_l1", "gaussian", "laplace"] = Field(
        "smooth_l1", description="gaussian, laplace: likelihood, for networks with log_sigma"
    )
    beta_mm: float = Field(2.0, gt=0, description="errors below are squared, those above are not")
    edge_weight: float = Field(
        0.2, ge=0, le=1, description="of depth at most 3 px from a rim; the interior has 1"
    )
    valid_weight: float = Field(20.0, ge=0, description="of the cross entropy of validity")
    choice_weight: float = Field(
        5.0, ge=0, description="of the cross entropy of the surface, if the network chooses one"
    )
    slope_weight: float = Field(
        3.0, ge=0, description="of the error of depth from pixel to pixel in the interior"
    )
    slope_beta_mm: float = Field(0.5, gt=0, description="as beta_mm, of such a difference")
    sigma_weight: float = Field(
        0.1, ge=0, description="of log_sigma, if any, with smooth_l1; depth does not feel it"
    )
    reach_px: int = Field(REACH_PX, ge=1, description="depth is asked for so near to a valid pixel")

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, Parts]:
        """Parts: depth, and valid, choice, slope and sigma where there is such a thing.

        Of several candidates only the right one's depth counts; sigma is that of the chosen one.
        """
        there = (clean_mm > 0).float()
        asked = there * grown(noisy_mm > 0, self.reach_px)
        inside = asked * interior(clean_mm)
        error = prediction.depth_mm - clean_mm
        choice = None
        if prediction.candidates_mm is not None and prediction.choice_logits is not None:
            errors = prediction.candidates_mm - clean_mm
            right = right_surface(errors.detach())
            error = errors.gather(1, right)
            choice = _negative_log(prediction.choice_logits, right)
        weight = self.edge_weight * asked + (1 - self.edge_weight) * inside
        parts = {"depth": mean_where(self._depth(error, prediction.log_sigma), weight)}
        total = parts["depth"]
        if self.valid_weight and prediction.valid_logit is not None:
            parts["valid"] = functional.binary_cross_entropy_with_logits(
                prediction.valid_logit, there
            )
            total = total + self.valid_weight * parts["valid"]
        if choice is not None:
            parts["choice"] = mean_where(choice, asked)
            total = total + self.choice_weight * parts["choice"]
        if self.slope_weight:
            parts["slope"] = self._slope(error, inside)
            total = total + self.slope_weight * parts["slope"]
        if self.sigma_weight and self.depth == "smooth_l1" and prediction.log_sigma is not None:
            said = (prediction.depth_mm - clean_mm).detach()
            parts["sigma"] = mean_where(_laplace(said, prediction.log_sigma), asked)
            total = total + self.sigma_weight * parts["sigma"]
        return total, parts

    def _depth(self, error_mm: Tensor, log_sigma: Tensor | None) -> Tensor:
        """Per pixel."""
        if self.depth == "smooth_l1":
            return _smooth(error_mm, self.beta_mm)
        if log_sigma is None:
            raise ConfigError(
                f"loss.depth = {self.depth!r} needs a network that predicts its uncertainty: set "
                'model.uncertainty = true, or loss.depth = "smooth_l1"'
            )
        if self.depth == "gaussian":
            return 0.5 * (error_mm * torch.exp(-log_sigma)).square() + log_sigma
        return _laplace(error_mm, log_sigma)

    def _slope(self, error_mm: Tensor, inside: Tensor) -> Tensor:
        """Of rows and of columns, added."""
        terms = []
        for axis in (-2, -1):
            step = _ahead(error_mm, axis) - _behind(error_mm, axis)
            both = _behind(inside, axis) * _ahead(inside, axis)
            terms.append(mean_where(_smooth(step, self.slope_beta_mm), both))
        return torch.stack(terms).sum()


def right_surface(errors_mm: Tensor) -> Tensor:
    """(B, 1, H, W) which of (B, K, H, W) candidates a pixel is on: the first unless another is
    nearer to the truth by `_ANOTHER_MM`, so that one surface with three names has one.
    """
    size = errors_mm.abs()
    size = torch.cat([size[:, :1] - _ANOTHER_MM, size[:, 1:]], dim=1)
    return size.argmin(dim=1, keepdim=True)


def _negative_log(logits: Tensor, right: Tensor) -> Tensor:
    """(B, 1, H, W) cross entropy."""
    return -logits.log_softmax(dim=1).gather(1, right)


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


def _laplace(error_mm: Tensor, log_sigma: Tensor) -> Tensor:
    """Minus the log of a Laplace density with standard deviation sigma: scale sigma / sqrt 2."""
    return 2**0.5 * error_mm.abs() * torch.exp(-log_sigma) + log_sigma + 0.5 * log(2)


def _smooth(values: Tensor, beta: float) -> Tensor:
    return functional.smooth_l1_loss(values, torch.zeros_like(values), reduction="none", beta=beta)


def mean_where(values: Tensor, weights: Tensor) -> Tensor:
    """Over the pixels that count; 0 if there are none."""
    return (values * weights).sum() / weights.sum().clamp_min(1)


def _ahead(image: Tensor, axis: int) -> Tensor:
    return image.narrow(axis, 1, image.shape[axis] - 1)


def _behind(image: Tensor, axis: int) -> Tensor:
    return image.narrow(axis, 0, image.shape[axis] - 1)
