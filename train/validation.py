"""What is measured while training: few figures, on the same frames each time, cheap to have."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

import torch
from torch import Tensor

from glsim.train.interior import interior
from glsim.train.losses import Loss, in_float32
from glsim.train.models.base import Prediction

#: Less than this is 0 in a 16-bit file in millimetres.
HALF_MM: Final = 0.5


class Sums(NamedTuple):
    """Of one batch; each a scalar. What is averaged at the end over all frames at once."""

    loss: Tensor
    square: Tensor
    pixels: Tensor
    inner_square: Tensor
    inner: Tensor
    flips: Tensor
    frames: Tensor


def validate(
    model: Callable[[Tensor], Prediction], batches: Iterable[list[Tensor]], loss: Loss
) -> dict[str, float]:
    """Figures of a network in the state that it is in, lower is better; NaN where undefined.

    loss: the training's. mse_mm2: over all pixels, hard decision on validity. interior_rmse_mm:
    where prediction and truth have depth, more than 3 px from an edge of the truth. flips: pixels
    a frame whose validity is wrong.
    """
    sums = []
    with torch.no_grad():
        for noisy_mm, clean_mm in batches:
            sums.append(_sums(model(noisy_mm), noisy_mm, clean_mm, loss))
    total = Sums(*(torch.stack(parts).sum().item() for parts in zip(*sums, strict=True)))
    inner_mm2 = total.inner_square / total.inner if total.inner else math.nan
    return {
        "loss": total.loss / total.frames,
        "mse_mm2": total.square / total.pixels,
        "interior_rmse_mm": math.sqrt(inner_mm2),
        "flips": total.flips / total.frames,
    }


def _sums(prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor, loss: Loss) -> Sums:
    prediction = in_float32(prediction)
    hard = prediction.hard_mm()
    hard = torch.where(hard >= HALF_MM, hard, 0.0)
    error = (hard - clean_mm).double()
    inner = interior(clean_mm) & (hard > 0)
    frames = torch.tensor(float(len(clean_mm)), dtype=torch.float64, device=clean_mm.device)
    return Sums(
        loss(prediction, noisy_mm, clean_mm)[0].double() * frames,
        error.square().sum(),
        frames * clean_mm[0].numel(),
        error[inner].square().sum(),
        inner.sum().double(),
        ((hard > 0) != (clean_mm > 0)).sum().double(),
        frames,
    )
