"""Calibration of predicted uncertainty: one factor on sigma, fitted on validation frames.

Temperature scaling (Guo et al., "On Calibration of Modern Neural Networks", ICML 2017) for
regression: Levi et al., "Evaluating and Calibrating Uncertainty Prediction in Regression Tasks",
Sensors 22, 2022. One factor keeps the order of pixels, and cannot overfit.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

import torch
from torch import Tensor

from glsim.errors import ConfigError
from glsim.train.models.mask_aware import MaskAware

#: Median of |x| for a standard normal x.
_MEDIAN_NORMAL: Final = 0.6744898


def sigma_scale(
    standardised: Tensor, fit: Literal["mean_square", "median"] = "mean_square"
) -> float:
    """Fit the factor on sigma to errors divided by sigma, of any shape.

    "mean_square" makes the mean of their squares 1, silhouettes included; "median" makes half of
    them smaller than 0.67, which describes surfaces and ignores tails. Raises ConfigError if there
    is nothing to fit: no pixel, only errors of 0, or a value that is not finite.
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
    """Set ``model.sigma_scale`` from validation pairs (noisy_mm, clean_mm), (B, 1, H, W) each.

    Uses the pixels that have depth in both prediction and truth. Returns the new factor; the mode
    of the model (train or eval) stays. Raises ConfigError for a model without uncertainty, and as
    `sigma_scale`.
    """
    if not model.uncertainty:
        raise ConfigError("calibration: the model predicts no sigma; set uncertainty = true")
    training = model.training
    model.eval()
    standardised = [torch.zeros(0)]
    for noisy_mm, clean_mm in pairs:
        prediction = model(noisy_mm)
        unscaled = (prediction.log_sigma - model.sigma_scale.log()).exp()
        both = (clean_mm > 0) & (prediction.valid_logit > 0)
        standardised.append(((prediction.depth_mm - clean_mm) / unscaled)[both].cpu())
    model.train(training)
    scale = sigma_scale(torch.cat(standardised), fit)
    model.sigma_scale.fill_(scale)
    return scale
