"""Uncertainty that holds what it says: one factor, fitted on frames that training did not see.

Temperature scaling (Guo et al., "On Calibration of Modern Neural Networks", ICML 2017) as it is for
regression: Levi et al., "Evaluating and Calibrating Uncertainty Prediction in Regression Tasks",
Sensors 22, 2022. One factor keeps the order of pixels, and cannot overfit.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

import torch
from torch import Tensor

from glsim.errors import ConfigError

from .mask_aware import MaskAware

#: Median of |x| for a standard normal x.
_MEDIAN_NORMAL: Final = 0.6744898


def sigma_scale(
    standardised: Tensor, fit: Literal["mean_square", "median"] = "mean_square"
) -> float:
    """The factor on sigma that errors over sigma, of any shape, ask for.

    "mean_square" makes the mean of their squares 1, silhouettes and all; "median" makes half of
    them smaller than 0.67, which describes surfaces and disregards tails. Raises ConfigError
    where there is nothing to fit: no pixel, no error at all, or a value that is not finite.
    """
    size = standardised.abs().double()
    if not size.numel() or not bool(size.isfinite().all()):
        raise ConfigError("calibration: no finite errors; give frames with depth to compare")
    scale = size.square().mean().sqrt() if fit == "mean_square" else size.median() / _MEDIAN_NORMAL
    if not scale > 0:
        raise ConfigError("calibration: the errors are all 0; give frames with noise")
    return float(scale)


@torch.no_grad()
def calibrate(
    model: MaskAware,
    pairs: Iterable[tuple[Tensor, Tensor]],
    fit: Literal["mean_square", "median"] = "mean_square",
) -> float:
    """Set ``model.sigma_scale`` by validation pairs (noisy_mm, clean_mm), (B, 1, H, W) each.

    Counts the pixels that the model calls depth and that are depth. Returns the new factor; the
    model is left in the mode (train or eval) it came in. Raises ConfigError for a model without
    uncertainty, and as `sigma_scale`.
    """
    if not model.uncertainty:
        raise ConfigError("calibration: the model predicts no sigma; set uncertainty = true")
    training = model.training
    model.eval()
    standardised = [torch.zeros(0)]
    for noisy_mm, clean_mm in pairs:
        said = model(noisy_mm)
        unscaled = (said.log_sigma - model.sigma_scale.log()).exp()
        depth = (clean_mm > 0) & (said.valid_logit > 0)
        standardised.append(((said.depth_mm - clean_mm) / unscaled)[depth].cpu())
    model.train(training)
    scale = sigma_scale(torch.cat(standardised), fit)
    model.sigma_scale.fill_(scale)
    return scale
