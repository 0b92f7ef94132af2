"""Calibration of predicted uncertainty: one factor on sigma, fitted on validation frames.

Temperature scaling (Guo et al., "On Calibration of Modern Neural Networks", ICML 2017) for
regression: Levi et al., "Evaluating and Calibrating Uncertainty Prediction in Regression Tasks",
Sensors 22, 2022. One factor keeps the order of pixels, and cannot overfit.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import torch
from torch import Tensor

from glsim.core.errors import ConfigError
from glsim.train.models.mask_aware import MaskAware

#: Median of |x| for a standard normal x.
_MEDIAN_NORMAL: Final = 0.6744898


@torch.no_grad()
def calibrate(model: MaskAware, pairs: Iterable[tuple[Tensor, Tensor]]) -> float:
    """Set ``model.sigma_scale`` from validation pairs (noisy_mm, clean_mm), (B, 1, H, W) each.

    Half of the errors are then smaller than 0.67 sigma, which describes surfaces and ignores tails.
    Uses the pixels that have depth in both prediction and truth. Returns the factor; the mode of
    the model (train or eval) stays. Raises ConfigError for a model without uncertainty, and if
    there is nothing to fit: no pixel, only errors of 0, or a value that is not finite.
    """
    if not model.uncertainty:
        raise ConfigError("calibration: the model predicts no sigma; set uncertainty = true")
    training = model.training
    model.eval()
    parts = [torch.zeros(0)]
    for noisy_mm, clean_mm in pairs:
        prediction = model(noisy_mm)
        unscaled = (prediction.log_sigma - model.sigma_scale.log()).exp()
        both = (clean_mm > 0) & (prediction.valid_logit > 0)
        parts.append(((prediction.depth_mm - clean_mm) / unscaled)[both].cpu())
    model.train(training)
    size = torch.cat(parts).abs().double()
    if not size.numel() or not bool(size.isfinite().all()) or not size.any():
        raise ConfigError("calibration: no finite errors; give noisy frames with depth to compare")
    scale = float(size.median()) / _MEDIAN_NORMAL
    model.sigma_scale.fill_(scale)
    return scale
