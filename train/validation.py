"""Validation metrics during training: few and cheap, always on the same frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import torch
from torch import Tensor

from glsim.denoise.interface import MIN_DEPTH_MM
from glsim.train.interior_mask import interior_mask
from glsim.train.losses.base import Loss, to_float32
from glsim.train.models.base import Prediction


class _FigureSums(NamedTuple):
    """Sums over one batch, each a scalar; they are added over batches and divided at the end."""

    loss: Tensor
    square_mm2: Tensor
    pixels: Tensor
    interior_square_mm2: Tensor
    interior_pixels: Tensor
    flips: Tensor
    frames: Tensor


def validation_figures(
    model: Callable[[Tensor], Prediction], batches: Iterable[tuple[Tensor, Tensor]], loss: Loss
) -> dict[str, float]:
    """Compute the validation metrics of a network; lower is better, NaN is undefined.

    Args:
        model: the network, in evaluation mode.
        batches: (noisy_mm, clean_mm), (B, C, H, W) and (B, 1, H, W).
        loss: the training loss.

    Returns:
        loss: mean of the training loss.
        mse_mm2: mean squared error of all pixels; pixels predicted invalid count as 0.
        interior_rmse_mm: RMSE where both have depth, more than 3 px from an edge of the truth.
        flips: pixels per frame of wrong validity.
    """
    sums = []
    with torch.no_grad():
        for noisy_mm, clean_mm in batches:
            sums.append(_figure_sums(model(noisy_mm), noisy_mm[:, :1], clean_mm, loss))
    total = _FigureSums(*(torch.stack(parts).sum() for parts in zip(*sums, strict=True)))
    figures = {
        "loss": total.loss / total.frames,
        "mse_mm2": total.square_mm2 / total.pixels,
        "interior_rmse_mm": (total.interior_square_mm2 / total.interior_pixels).sqrt(),
        "flips": total.flips / total.frames,
    }
    return {name: float(value) for name, value in figures.items()}


def _figure_sums(
    prediction: Prediction, noisy_mm: Tensor, clean_mm: Tensor, loss: Loss
) -> _FigureSums:
    prediction = to_float32(prediction)
    hard_mm = prediction.hard_mm()
    hard_mm = torch.where(hard_mm >= MIN_DEPTH_MM, hard_mm, 0.0)
    error_mm = (hard_mm - clean_mm).double()
    inside = interior_mask(clean_mm) & (hard_mm > 0)
    frames = torch.tensor(float(len(clean_mm)), dtype=torch.float64, device=clean_mm.device)
    return _FigureSums(
        loss=loss(prediction, noisy_mm, clean_mm)[0].double() * frames,
        square_mm2=error_mm.square().sum(),
        pixels=frames * clean_mm[0].numel(),
        interior_square_mm2=error_mm[inside].square().sum(),
        interior_pixels=inside.sum().double(),
        flips=((hard_mm > 0) != (clean_mm > 0)).sum().double(),
        frames=frames,
    )
