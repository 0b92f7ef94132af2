"""Rows of frames to means a method, subject by subject, without keeping the rows."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from .blocks import BINS, Row
from .metrics import METRICS, Metric
from .metrics.score import psnr_db
from .statistics import BySubject, holm, interval, sign_flip

_T = TypeVar("_T")

#: A number of the whole set rather than of a frame.
PSNR_OF_MEAN: Final = Metric(
    "psnr_of_mean_db", "dB", "higher", "paper", "PSNR of the mean MSE over all frames"
)
#: Frames of each method that figures show, and the metrics that are kept of them.
_SHOWN: Final = 1000
KEPT: Final = (
    "mse_mm2",
    "flips_px",
    "flying_px",
    "both_interior_rmse_mm",
    "input_interior_rmse_mm",
    "normal_mean_deg",
)


@dataclass(frozen=True)
class Entry:
    """A metric of a method over the set, with its 95 % interval over subjects.

    frames: where it is defined; undefined: where it is not. p: of no difference from the first
    method (sign-flip over subjects), p_holm: corrected for the number of methods.
    """

    metric: Metric
    mean: float
    low: float
    high: float
    frames: int
    undefined: int
    p: float = float("nan")
    p_holm: float = float("nan")


class _Totals:
    """(K,) sums and counts of each subject, K metrics."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = list(names)
        self.by_subject: dict[str, NDArray[np.float64]] = {}

    def add(self, row: Row) -> None:
        table = self.by_subject.setdefault(row["subject"], np.zeros((3, len(self._names))))
        values = np.array([np.nan if row[name] is None else row[name] for name in self._names])
        defined = ~np.isnan(values)
        table[0] += np.where(defined, values, 0)
        table[1] += defined
        table[2] += 1

    def of(self, name: str, subjects: Iterable[str]) -> BySubject:
        nothing = np.zeros((3, len(self._names)))
        stack = np.stack([self.by_subject.get(subject, nothing) for subject in subjects])
        return BySubject(*stack[:, :, self._names.index(name)].T)


@dataclass
class Summary:
    """What is left of the rows: memory grows with subjects and methods, not with frames.

    metrics: what the rows hold. shown: method -> KEPT of frames evenly spread over the set.
    histograms: method -> counts of |error| in bins of ``blocks.BIN_MM``.
    """

    total_frames: int
    metrics: Mapping[str, Metric] = field(default_factory=lambda: METRICS)
    shown: dict[str, list[list[float]]] = field(default_factory=dict)
    histograms: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    _totals: dict[str, _Totals] = field(default_factory=dict)
    _rows: dict[str, int] = field(default_factory=dict)

    @property
    def methods(self) -> list[str]:
        """In the order in which they were given."""
        return list(self._totals)

    @property
    def subjects(self) -> list[str]:
        """Everybody who was seen."""
        return sorted({name for totals in self._totals.values() for name in totals.by_subject})

    def only(self, denoisers: Collection[str]) -> Summary:
        """Of these denoisers, by their labels; with all parts of a soft validity."""

        def chosen(of: dict[str, _T]) -> dict[str, _T]:
            return {name: value for name, value in of.items() if name.split(" [")[0] in denoisers}

        parts = (self.shown, self.histograms, self._totals, self._rows)
        return Summary(self.total_frames, self.metrics, *(chosen(part) for part in parts))

    def add(self, row: Row) -> None:
        """One frame of one method."""
        method = row["method"]
        if method not in self._totals:
            self._totals[method] = _Totals(self.metrics)
        self._totals[method].add(row)
        number = self._rows.get(method, 0)
        self._rows[method] = number + 1
        if number % max(1, self.total_frames // _SHOWN) == 0:
            values = [float("nan") if row[name] is None else row[name] for name in KEPT]
            self.shown.setdefault(method, []).append(values)

    def add_histogram(self, method: str, counts: list[int]) -> None:
        """Counts of one block."""
        total = self.histograms.setdefault(method, np.zeros(BINS + 1, np.int64))
        total += np.asarray(counts)

    def frames_shown(self, method: str, *metrics: str) -> NDArray[np.float64]:
        """(N, K) of up to two thousand frames, KEPT metrics only; those that have all of them."""
        values = np.array(self.shown[method])[:, [KEPT.index(name) for name in metrics]]
        found: NDArray[np.float64] = values[~np.isnan(values).any(axis=1)]
        return found

    def values(self, method: str, metric: str) -> BySubject:
        """Of a method's metric, everybody in the order of ``subjects``."""
        return self._totals[method].of(metric, self.subjects)

    def mean(self, method: str, metric: str) -> float:
        """Over the frames where it is defined."""
        return self.values(method, metric).mean

    def entries(self, method: str) -> dict[str, Entry]:
        """Every metric of a method by name, PSNR_OF_MEAN among them; p by ``compared``."""
        result: dict[str, Entry] = {}
        for name, metric in self.metrics.items():
            values = self.values(method, name)
            low, high = interval(values)
            result[name] = Entry(
                metric, values.mean, low, high, int(values.counts.sum()), values.undefined
            )
            if name == "psnr_db":
                mse = result["mse_mm2"]
                mean, low, high = (psnr_db(value) for value in (mse.mean, mse.high, mse.low))
                result[PSNR_OF_MEAN.name] = Entry(
                    PSNR_OF_MEAN, mean, low, high, mse.frames, mse.undefined
                )
        return result

    def compared(self) -> dict[str, dict[str, Entry]]:
        """Method -> metric -> entry, with p values against the first method."""
        first, *others = self.methods
        table = {method: self.entries(method) for method in self.methods}
        for name in self.metrics:
            base = self.values(first, name)
            p = np.array([sign_flip(self.values(other, name), base) for other in others])
            for other, raw, corrected in zip(others, p, holm(p), strict=True):
                fields: dict[str, Any] = vars(table[other][name]) | {"p": raw, "p_holm": corrected}
                table[other][name] = Entry(**fields)
        return table
