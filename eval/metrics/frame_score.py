"""Scoring of one frame by METRICS: the shipped ones, and entry points "glsim.metrics"."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.plugins import each_usable, load_plugin, plugin_names
from glsim.eval.metrics.definitions import SHIPPED_METRICS
from glsim.eval.metrics.form import systematic_mm2
from glsim.eval.metrics.metric import Metric
from glsim.eval.metrics.regions import REGION_METRICS
from glsim.eval.metrics.scored_map import ScoredMap, Truth


def _all_metrics() -> dict[str, Metric]:
    def plugin(name: str) -> Any:
        return load_plugin("metrics", name, lambda value: isinstance(value, Metric))

    shipped: dict[str, Metric] = {metric.name: metric for metric in SHIPPED_METRICS}
    plugins = each_usable(plugin_names("metrics", shipped), plugin)
    return shipped | {name: replace(metric, name=name) for name, metric in plugins}


#: Name -> metric, in the order of the columns of rows.csv.
METRICS: Final = _all_metrics()


def metrics_with_regions(regions: Iterable[str]) -> dict[str, Metric]:
    """Return METRICS and the metrics of each face region."""
    per_region = [
        replace(
            METRICS[base],
            name=f"{name}@{region}",
            help=f"{METRICS[base].help}; the part of the face called {region} alone",
            in_table=False,
        )
        for region in regions
        for name, base in REGION_METRICS.items()
    ]
    return METRICS | {metric.name: metric for metric in per_region}


def score(
    prediction_mm: NDArray[np.generic],
    truth: Truth,
    earlier_mm: tuple[Depth | None, Depth | None] = (None, None),
) -> dict[str, float]:
    """Compute all metrics of a frame but the time: name -> value, regions last; NaN = undefined.

    Raises DenoiserError for an invalid prediction, see ``ScoredMap``.

    Args:
        prediction_mm: (H, W) millimetres, 0 = no depth.
        earlier_mm: prediction and clean map of the previous frame, see ``systematic_mm2``.
    """
    prediction = ScoredMap(prediction_mm, truth)
    scores = {m.name: m.value(prediction) for m in METRICS.values() if m.value is not None}
    scores["systematic_mm2"] = systematic_mm2(prediction, *earlier_mm)
    if truth.regions is None:
        return scores
    errors = truth.regions.errors(*prediction.errors("input", "interior"))
    return scores | errors | truth.regions.angles(*prediction.angles)
