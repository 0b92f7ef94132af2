"""Rows of frames to means a method, subject by subject, without keeping the rows."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from .blocks import BINS, Row
from .metrics import METRICS, Metric
from .metrics.score import psnr_db
from .statistics import BySubject, holm, interval, sign_flip

_T = TypeVar("_T")

_NAMES: Final = list(METRICS)

#: A number of the whole set rather than of a frame.
PSNR_OF_MEAN: Final = Metric(
    "psnr_of_mean_db", "dB", "higher", "paper", "PSNR of the mean MSE over all frames"
)
#: Frames that the scatter plot keeps of each method.
_POINTS: Final = 1000


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

    def __init__(self) -> None:
        self.by_subject: dict[str, NDArray[np.float64]] = {}

    def add(self, row: Row) -> None:
        table = self.by_subject.setdefault(row["subject"], np.zeros((3, len(_NAMES))))
        values = np.array([np.nan if row[name] is None else row[name] for name in _NAMES])
        defined = ~np.isnan(values)
        table[0] += np.where(defined, values, 0)
        table[1] += defined
        table[2] += 1

    def of(self, name: str, subjects: Iterable[str]) -> BySubject:
        nothing = np.zeros((3, len(_NAMES)))
        stack = np.stack([self.by_subject.get(subject, nothing) for subject in subjects])
        return BySubject(*stack[:, :, _NAMES.index(name)].T)


@dataclass
class Summary:
    """What is left of the rows: memory grows with subjects and methods, not with frames.

    points: method -> (MSE, interior RMSE) of frames evenly spread over the set.
    histograms: method -> counts of |error| in bins of ``blocks.BIN_MM``.
    """

    total_frames: int
    points: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
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

        parts = (self.points, self.histograms, self._totals, self._rows)
        return Summary(self.total_frames, *(chosen(part) for part in parts))

    def add(self, row: Row) -> None:
        """One frame of one method."""
        method = row["method"]
        self._totals.setdefault(method, _Totals()).add(row)
        number = self._rows.get(method, 0)
        self._rows[method] = number + 1
        point = row["mse_mm2"], row["both_interior_rmse_mm"]
        if number % max(1, self.total_frames // _POINTS) == 0 and None not in point:
            self.points.setdefault(method, []).append(point)

    def add_histogram(self, method: str, counts: list[int]) -> None:
        """Counts of one block."""
        total = self.histograms.setdefault(method, np.zeros(BINS + 1, np.int64))
        total += np.asarray(counts)

    def values(self, method: str, metric: str) -> BySubject:
        """Of a method's metric, everybody in the order of ``subjects``."""
        return self._totals[method].of(metric, self.subjects)

    def mean(self, method: str, metric: str) -> float:
        """Over the frames where it is defined."""
        return self.values(method, metric).mean

    def entries(self, method: str) -> dict[str, Entry]:
        """Every metric of a method by name, PSNR_OF_MEAN among them; p by ``compared``."""
        result: dict[str, Entry] = {}
        for name, metric in METRICS.items():
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
        for name in METRICS:
            base = self.values(first, name)
            p = np.array([sign_flip(self.values(other, name), base) for other in others])
            for other, raw, corrected in zip(others, p, holm(p), strict=True):
                fields: dict[str, Any] = vars(table[other][name]) | {"p": raw, "p_holm": corrected}
                table[other][name] = Entry(**fields)
        return table
