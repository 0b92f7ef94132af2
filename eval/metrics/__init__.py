"""Metrics of one frame: ``definitions`` lists them with unit, direction and function."""

from glsim.eval.metrics.metric import Metric
from glsim.eval.metrics.prediction import Truth
from glsim.eval.metrics.regions import REGION_METRICS, Regions, region_column
from glsim.eval.metrics.score import METRICS, metrics_with_regions, score

__all__ = [
    "METRICS",
    "REGION_METRICS",
    "Metric",
    "Regions",
    "Truth",
    "metrics_with_regions",
    "region_column",
    "score",
]
