"""The interface of all losses. A loss is the table [loss] of a recipe and a callable.

Arguments are a prediction, the noisy and the clean depth, each (B, 1, H, W) float32 millimetres
with 0 = no depth. Only the network sees further inputs (``glsim.denoise.inputs``). Results are
the total and its parts by name. All arithmetic is float32.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from pydantic import BaseModel, ConfigDict
from torch import Generator, Tensor

from glsim.train.models.base import Prediction

LossParts = dict[str, Tensor]


class Loss(BaseModel):
    """Base class of all losses."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    #: Whether a lower value on validation frames means a better network.
    can_be_monitored: ClassVar[bool] = True
    #: Whether it trains networks of single depth frames alone, because it changes their input.
    depth_alone: ClassVar[bool] = False

    def __call__(
        self, prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor
    ) -> tuple[Tensor, LossParts]:
        """Return the total, a scalar, and its parts."""
        raise NotImplementedError

    def training_loss(
        self,
        model: Callable[[Tensor], Prediction],
        noisy_mm: Tensor,
        clean_mm: Tensor,
        generator: Generator,
    ) -> tuple[Tensor, LossParts]:
        """Run the network on a batch and return its loss; losses that change the input override it.

        Args:
            model: the network.
            noisy_mm: (B, C, H, W) all inputs of the network.
            clean_mm: (B, 1, H, W) target.
            generator: random numbers of this step, on the CPU.

        Returns:
            The total, a scalar, and its parts.
        """
        return self(to_float32(model(noisy_mm)), noisy_mm[:, :1], clean_mm)


def to_float32(prediction: Prediction) -> Prediction:
    """Convert a prediction made in mixed precision to float32."""
    depth_mm, *others = prediction
    return Prediction(
        depth_mm.float(), *(None if part is None else part.float() for part in others)
    )


def weighted_mean(values: Tensor, weights: Tensor) -> Tensor:
    """Weighted mean over pixels; 0 if all weights are 0."""
    return (values * weights).sum() / weights.sum().clamp_min(1)
