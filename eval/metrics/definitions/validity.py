"""Metrics of the mask: which pixels have depth."""

from __future__ import annotations

import math

import numpy as np

from glsim.eval.metrics.metric import Metric
from glsim.eval.metrics.prediction import FLYING_MM, Prediction


def _share(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


def _iou(prediction: Prediction) -> float:
    hits, _, _ = prediction.counts
    return _share(hits, hits + prediction.flips)


def _precision(prediction: Prediction) -> float:
    hits, predicted, _ = prediction.counts
    return _share(hits, predicted)


def _recall(prediction: Prediction) -> float:
    hits, _, real = prediction.counts
    return _share(hits, real)


def _flying_px(prediction: Prediction) -> float:
    hits, predicted, _ = prediction.counts
    error = prediction.error[prediction.valid & prediction.truth.valid]
    return float(int(np.count_nonzero(np.abs(error) > FLYING_MM)) + predicted - hits)


VALIDITY_METRICS = (
    Metric("iou", "1", "higher", "validity", "valid in both / valid in either", _iou, True),
    Metric(
        "precision",
        "1",
        "higher",
        "validity",
        "share of the predicted pixels that exist",
        _precision,
        in_table=True,
    ),
    Metric(
        "recall",
        "1",
        "higher",
        "validity",
        "share of the clean pixels that are predicted",
        _recall,
        in_table=True,
    ),
    Metric(
        "flips_px",
        "px",
        "lower",
        "validity",
        "pixels valid in one of both only",
        lambda prediction: float(prediction.flips),
        in_table=True,
    ),
    Metric(
        "flying_px",
        "px",
        "lower",
        "validity",
        f"predicted more than {FLYING_MM:.0f} mm off, or where there is no surface",
        _flying_px,
        in_table=True,
    ),
)
