"""Statistics of the depth error over sets of pixels: ``both_interior_rmse_mm``."""

from __future__ import annotations

from functools import partial
from typing import Final

from glsim.eval.metrics.metric import Direction, Metric
from glsim.eval.metrics.prediction import Prediction
from glsim.geometry.edges import BAND_PX

#: (Base set, part) of ``Prediction.errors`` -> definition of the pixels.
_BOTH: Final = "prediction and clean valid"
_INPUT: Final = (
    "input and clean valid, the same pixels for every method; where the method has no "
    "depth its input's stands in"
)
_INTERIOR: Final = f", more than {BAND_PX} px from an edge of the clean map"
_EDGE: Final = f", at most {BAND_PX} px from an edge of the clean map"
_SETS: Final = {
    ("both", "all"): _BOTH,
    ("both", "interior"): _BOTH + _INTERIOR,
    ("both", "edge"): _BOTH + _EDGE,
    ("input", "all"): _INPUT,
    ("input", "interior"): _INPUT + _INTERIOR,
    ("input", "edge"): _INPUT + _EDGE,
    ("filled", "all"): "prediction and clean valid, input not",
}
#: Statistics of the error, prediction - clean: key -> (direction, definition).
_STATISTICS: Final[dict[str, tuple[Direction, str]]] = {
    "rmse": ("lower", "root mean square error"),
    "mae": ("lower", "mean absolute error"),
    "median": ("lower", "median absolute error"),
    "p95": ("lower", "95th percentile of the absolute error"),
    "bias": ("neither", "mean error, positive is too far"),
}
_IN_TABLE: Final = (
    "both_rmse_mm",
    "input_rmse_mm",
    "both_interior_rmse_mm",
    "both_edge_rmse_mm",
    "filled_rmse_mm",
    "input_bias_mm",
)


def _statistic(prediction: Prediction, base: str, part: str, key: str) -> float:
    return prediction.statistics(base, part)[key]


def _metric(base: str, part: str, key: str) -> Metric:
    better, words = _STATISTICS[key]
    name = f"{base}_{key}_mm" if part == "all" else f"{base}_{part}_{key}_mm"
    return Metric(
        name,
        "mm",
        better,
        "depth",
        f"{words} where {_SETS[base, part]}",
        partial(_statistic, base=base, part=part, key=key),
        name in _IN_TABLE,
    )


DEPTH_METRICS = tuple(_metric(base, part, key) for base, part in _SETS for key in _STATISTICS)
