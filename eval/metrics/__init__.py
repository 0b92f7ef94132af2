"""Metrics of one frame. ``catalogue`` lists them with unit and direction."""

from glsim.eval.metrics.catalogue import METRICS, Metric
from glsim.eval.metrics.regions import REGION_METRICS, Regions, metrics_with_regions, region_column
from glsim.eval.metrics.score import Truth, score

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
