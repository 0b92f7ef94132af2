"""Metrics of surface normals."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from glsim.eval.metrics.metric import Metric
from glsim.eval.metrics.prediction import Prediction

#: A normal with a smaller error, degrees, counts as good.
_GOOD_DEG: Final = 10.0


def _mean_deg(prediction: Prediction) -> float:
    angle, _ = prediction.angles
    return float(angle.mean()) if angle.size else math.nan


def _median_deg(prediction: Prediction) -> float:
    angle, _ = prediction.angles
    return float(np.median(angle)) if angle.size else math.nan


def _good_pct(prediction: Prediction) -> float:
    angle, _ = prediction.angles
    return 100.0 * float((angle < _GOOD_DEG).mean()) if angle.size else math.nan


NORMAL_METRICS = (
    Metric(
        "normal_mean_deg",
        "°",
        "lower",
        "normals",
        "mean angle between the normals",
        _mean_deg,
        in_table=True,
    ),
    Metric(
        "normal_median_deg",
        "°",
        "lower",
        "normals",
        "median angle between the normals",
        _median_deg,
    ),
    Metric(
        "normal_good_pct",
        "%",
        "higher",
        "normals",
        f"normals that are less than {_GOOD_DEG:.0f}° off",
        _good_pct,
        in_table=True,
    ),
)
