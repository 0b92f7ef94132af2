"""Means of each method over subjects, accumulated frame by frame."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.composites import COMPOSITES, DEFAULT_COMPOSITE
from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.metrics.metric import Metric
from glsim.eval.metrics.scored_map import psnr_db
from glsim.eval.scoring.bias import BiasBin, BiasSums, add_bias, bias_by_distance
from glsim.eval.scoring.blocks import BINS, Row
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval

_T = TypeVar("_T")

#: The only metric that is computed over the whole set and not per frame.
PSNR_OF_MEAN: Final = Metric(
    "psnr_of_mean_db",
    "dB",
    "higher",
    "paper",
    "PSNR of the mean MSE over all frames",
    in_table=True,
)
#: Target number of frames per method for figures, and the metrics kept for them.
_SAMPLED_FRAMES: Final = 1000
_SAMPLED_METRICS: Final = ("mse_mm2", "both_interior_rmse_mm")


@dataclass(frozen=True)
class MetricMean:
    """The mean of a metric over the set, for one method, with its interval.

    Attributes:
        metric: what is averaged.
        mean: over frames.
        low: lower end of the 95 % interval over subjects.
        high: upper end.
        frames: number of frames where the metric is defined.
        undefined: number of the others.
    """

    metric: Metric
    mean: float
    low: float
    high: float
    frames: int
    undefined: int


@dataclass
class ScoreSummary:
    """Sums and samples of the scores; memory grows with subjects and methods, not with frames.

    Attributes:
        total_frames: of the set.
        metrics: name -> metric, the columns of the rows.
        sampled: method -> _SAMPLED_METRICS of frames spread evenly over the set.
        histograms: method -> counts of |error| in bins of ``blocks.BIN_MM``.
        bias_sums: method -> subject -> errors over distance.
    """

    total_frames: int
    metrics: Mapping[str, Metric] = field(default_factory=lambda: METRICS)
    sampled: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)
    histograms: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    bias_sums: BiasSums = field(default_factory=dict)
    _totals: dict[str, dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    _rows: dict[str, int] = field(default_factory=dict)

    @property
    def methods(self) -> list[str]:
        """Names of the methods in the given order."""
        return list(self._totals)

    @property
    def subjects(self) -> list[str]:
        """Names of all subjects, sorted."""
        return sorted({name for totals in self._totals.values() for name in totals})

    def only(self, denoisers: Collection[str]) -> ScoreSummary:
        """Return a summary of the denoisers with these labels, with all their composites."""
        return self._of({name for name in self.methods if name.split(" [")[0] in denoisers})

    def one_composite(self) -> ScoreSummary:
        """Return a summary with one row per denoiser: the default composite of a network."""
        others = tuple(f" [{name}]" for name in COMPOSITES if name != DEFAULT_COMPOSITE)
        return self._of({name for name in self.methods if not name.endswith(others)})

    def _of(self, methods: Collection[str]) -> ScoreSummary:
        def chosen(values: dict[str, _T]) -> dict[str, _T]:
            return {name: value for name, value in values.items() if name in methods}

        parts = (self.sampled, self.histograms, self.bias_sums, self._totals, self._rows)
        return ScoreSummary(self.total_frames, self.metrics, *(chosen(part) for part in parts))

    def add(self, row: Row) -> None:
        """Add the scores of one frame by one method."""
        method = row["method"]
        totals = self._totals.setdefault(method, {})
        table = totals.setdefault(row["subject"], np.zeros((3, len(self.metrics))))
        values = np.array([row[name] for name in self.metrics], np.float64)  # None is NaN
        defined = ~np.isnan(values)
        table += np.where(defined, values, 0), defined, np.ones(len(values))
        number = self._rows.get(method, 0)
        self._rows[method] = number + 1
        if number % max(1, self.total_frames // _SAMPLED_FRAMES) == 0:
            sampled = np.array([row[name] for name in _SAMPLED_METRICS], np.float64)
            self.sampled.setdefault(method, []).append(sampled)

    def add_histogram(self, method: str, counts: list[int]) -> None:
        """Add the error histograms of a block of frames."""
        total = self.histograms.setdefault(method, np.zeros(BINS + 1, np.int64))
        total += np.asarray(counts)

    def add_bias(self, sums: BiasSums) -> None:
        """Add the error sums by distance of a block of frames."""
        for method, subjects in sums.items():
            for subject, bins in subjects.items():
                add_bias(self.bias_sums, method, subject, bins)

    def bias_by_distance(self, method: str) -> list[BiasBin]:
        """Return the bias of a method in bins of 100 mm, from near to far."""
        return bias_by_distance(self.bias_sums.get(method, {}))

    def sampled_frames(self, method: str) -> NDArray[np.float64]:
        """Return (N, 2) MSE, mm^2, and interior RMSE, mm, of sampled frames that have both."""
        values = np.array(self.sampled[method])
        defined: NDArray[np.float64] = values[~np.isnan(values).any(axis=1)]
        return defined

    def values(self, method: str, metric: str) -> SubjectSums:
        """Return the sums of a metric for a method, in the order of ``subjects``."""
        place = list(self.metrics).index(metric)
        nothing = np.zeros((3, len(self.metrics)))
        tables = [self._totals[method].get(subject, nothing) for subject in self.subjects]
        return SubjectSums(*np.stack([table[:, place] for table in tables], axis=1))

    def mean(self, method: str, metric: str) -> float:
        """Compute the mean of a metric over the frames where it is defined."""
        return self.values(method, metric).mean

    def entries(self, method: str) -> dict[str, MetricMean]:
        """Compute the means of all metrics of a method by name, with PSNR_OF_MEAN."""
        result: dict[str, MetricMean] = {}
        for name, metric in self.metrics.items():
            values = self.values(method, name)
            low, high = bootstrap_interval(values)
            result[name] = MetricMean(
                metric, values.mean, low, high, int(values.counts.sum()), values.undefined
            )
            if name == "psnr_db":
                mse = result["mse_mm2"]
                mean, low, high = (psnr_db(value) for value in (mse.mean, mse.high, mse.low))
                result[PSNR_OF_MEAN.name] = MetricMean(
                    PSNR_OF_MEAN, mean, low, high, mse.frames, mse.undefined
                )
        return result

    def table(self) -> dict[str, dict[str, MetricMean]]:
        """Return the means of all methods: method -> metric -> mean."""
        return {method: self.entries(method) for method in self.methods}
