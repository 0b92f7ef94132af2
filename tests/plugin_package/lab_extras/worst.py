"""The metric ``worst_mm``."""

from __future__ import annotations

from typing import Any

import numpy as np

import glsim


def _worst(prediction: Any) -> float:
    error = np.abs(prediction.error[prediction.valid & prediction.truth.valid])
    return float(error.max()) if error.size else float("nan")


WORST = glsim.Metric(
    "worst_mm", "mm", "lower", "depth", "largest error of a pixel", _worst, in_table=True
)
