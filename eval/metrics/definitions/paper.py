"""The metrics of Kendrick, Yap and Tan: all pixels count, a hole is depth 0."""

from __future__ import annotations

import math
from functools import partial

from glsim.eval.metrics.metric import Metric
from glsim.eval.metrics.prediction import PSNR_MAX_MM, Prediction, psnr_db
from glsim.eval.metrics.ssim import PRESETS


def _flips_pct(prediction: Prediction) -> float:
    if not prediction.mse_mm2 > 0:
        return math.nan
    flipped = prediction.valid != prediction.truth.valid
    in_flips = float(prediction.squared[flipped].sum()) / prediction.squared.size
    return 100.0 * in_flips / prediction.mse_mm2


def _ssim(prediction: Prediction, preset: str) -> float:
    return prediction.ssim[preset]


PAPER_METRICS = (
    Metric(
        "mse_mm2",
        "mm²",
        "lower",
        "paper",
        "mean squared error over all pixels, holes = 0",
        lambda prediction: prediction.mse_mm2,
        in_table=True,
    ),
    Metric(
        "psnr_db",
        "dB",
        "higher",
        "paper",
        f"10 log10({PSNR_MAX_MM:.0f}² / MSE) of the frame; undefined for MSE 0",
        lambda prediction: psnr_db(prediction.mse_mm2),
        in_table=True,
    ),
    Metric(
        "mse_flips_pct",
        "%",
        "neither",
        "paper",
        "share of the squared error that is in pixels valid in one of both only",
        _flips_pct,
        in_table=True,
    ),
    *(
        Metric(
            f"ssim_{name}",
            "1",
            "higher",
            "paper",
            f"structural similarity, {preset}",
            partial(_ssim, preset=name),
            in_table=True,
        )
        for name, preset in PRESETS.items()
    ),
)
