"""Validation metrics during training: few and cheap, always on the same frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor

from glsim.denoise.interface import MIN_DEPTH_MM
from glsim.train.interior_mask import interior_mask
from glsim.train.losses.base import Loss, to_float32
from glsim.train.models.base import Prediction


@torch.no_grad()
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
    for noisy_mm, clean_mm in batches:
        prediction = to_float32(model(noisy_mm))
        hard_mm = prediction.hard_mm()
        hard_mm = torch.where(hard_mm >= MIN_DEPTH_MM, hard_mm, 0.0)
        square_mm2 = (hard_mm - clean_mm).double().square()
        inside = interior_mask(clean_mm) & (hard_mm > 0)
        frames = hard_mm.new_tensor(len(clean_mm), dtype=torch.float64)
        parts = (
            loss(prediction, noisy_mm[:, :1], clean_mm)[0].double() * frames,
            square_mm2.sum(),
            frames * clean_mm[0].numel(),
            square_mm2[inside].sum(),
            inside.sum().double(),
            ((hard_mm > 0) != (clean_mm > 0)).sum().double(),
            frames,
        )
        sums.append(torch.stack(parts))
    total, squares, pixels, inner, inner_pixels, flips, frames = torch.stack(sums).sum(0)
    figures = {
        "loss": total / frames,
        "mse_mm2": squares / pixels,
        "interior_rmse_mm": (inner / inner_pixels).sqrt(),
        "flips": flips / frames,
    }
    return {name: float(value) for name, value in figures.items()}
