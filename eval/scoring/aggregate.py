"""Means of each method over subjects, accumulated frame by frame."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.metrics.metric import Metric
from glsim.eval.scoring.bias import BiasBin, BiasSums, add_bias, bias_by_distance
from glsim.eval.scoring.blocks import Row, default_composites
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval

_T = TypeVar("_T")


@dataclass(frozen=True)
class MetricMean:
    """The mean of a metric over the set, for one method, with its 95 % interval over subjects.

    ``undefined`` counts the frames where the metric is undefined, ``frames`` the others.
    """

    metric: Metric
    mean: float
    low: float
    high: float
    frames: int
    undefined: int


@dataclass
class ScoreSummary:
    """Sums of scores by method and subject; memory does not grow with the number of frames.

    ``bias_sums``: method -> subject -> errors over distance.
    """

    metrics: Mapping[str, Metric] = field(default_factory=lambda: METRICS)
    bias_sums: BiasSums = field(default_factory=dict)
    _totals: dict[str, dict[str, NDArray[np.float64]]] = field(default_factory=dict)

    @property
    def methods(self) -> list[str]:
        """Names of the methods in the order in which they were added."""
        return list(self._totals)

    @property
    def subjects(self) -> list[str]:
        """Names of all subjects, sorted."""
        return sorted({name for totals in self._totals.values() for name in totals})

    def only(self, denoisers: Collection[str]) -> ScoreSummary:
        """Return the summary of the denoisers with these labels, including all their composites."""
        return self._of({name for name in self.methods if name.split(" [")[0] in denoisers})

    def one_composite(self) -> ScoreSummary:
        """Return a summary with one row per denoiser: the default composite of a network."""
        return self._of(default_composites(self.methods))

    def _of(self, methods: Collection[str]) -> ScoreSummary:
        def chosen(values: dict[str, _T]) -> dict[str, _T]:
            return {name: value for name, value in values.items() if name in methods}

        return ScoreSummary(self.metrics, chosen(self.bias_sums), chosen(self._totals))

    def add(self, row: Row) -> None:
        """Add the scores of one frame by one method."""
        method = row["method"]
        totals = self._totals.setdefault(method, {})
        table = totals.setdefault(row["subject"], np.zeros((3, len(self.metrics))))
        values = np.array([row[name] for name in self.metrics], np.float64)  # None is NaN
        defined = ~np.isnan(values)
        table += np.where(defined, values, 0), defined, np.ones(len(values))

    def add_bias(self, sums: BiasSums) -> None:
        """Add the error sums by distance of a block of frames."""
        for method, subjects in sums.items():
            for subject, bins in subjects.items():
                add_bias(self.bias_sums, method, subject, bins)

    def bias_by_distance(self, method: str) -> list[BiasBin]:
        """Return the bias of a method in bins of 100 mm, from near to far."""
        return bias_by_distance(self.bias_sums.get(method, {}))

    def values(self, method: str, metric: str) -> SubjectSums:
        """Return the sums of a metric for a method, in the order of ``subjects``."""
        column = list(self.metrics).index(metric)
        nothing = np.zeros((3, len(self.metrics)))
        tables = [self._totals[method].get(subject, nothing) for subject in self.subjects]
        return SubjectSums(*np.stack([table[:, column] for table in tables], axis=1))

    def mean(self, method: str, metric: str) -> float:
        """Compute the mean of a metric over the frames where it is defined."""
        return self.values(method, metric).mean

    def entries(self, method: str) -> dict[str, MetricMean]:
        """Compute the means of all metrics of a method by name."""
        result: dict[str, MetricMean] = {}
        for name, metric in self.metrics.items():
            values = self.values(method, name)
            low, high = bootstrap_interval(values)
            result[name] = MetricMean(
                metric, values.mean, low, high, int(values.counts.sum()), values.undefined
            )
        return result

    def table(self) -> dict[str, dict[str, MetricMean]]:
        """Return the means of all methods: method -> metric -> mean."""
        return {method: self.entries(method) for method in self.methods}
