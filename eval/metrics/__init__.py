"""One number a frame, each with its unit and direction: see ``catalogue``."""

from .catalogue import METRICS, Metric
from .score import Truth, score

__all__ = ["METRICS", "Metric", "Truth", "score"]
