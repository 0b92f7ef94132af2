"""One number a frame, each with its unit and direction: see ``catalogue``."""

from .catalogue import METRICS, Metric
from .regions import OF_REGION, Regions, column, metrics_with
from .score import Truth, score

__all__ = [
    "METRICS",
    "OF_REGION",
    "Metric",
    "Regions",
    "Truth",
    "column",
    "metrics_with",
    "score",
]
