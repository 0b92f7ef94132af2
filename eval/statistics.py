"""Means over frames, how sure they are, and whether two methods differ.

Frames of one subject are alike, so subjects are what is drawn again (bootstrap, Efron 1979) and
what is swapped (sign-flip test, Fisher 1935); p values are corrected for the number of methods
that are compared (Holm 1979).
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

#: Repetitions of the bootstrap: intervals move by less than a tenth of their width.
_DRAWS: Final = 2000
#: Up to this many subjects all sign flips are tried; beyond, _FLIPS random ones.
_EXACT: Final = 14
_FLIPS: Final = 20_000
_SEED: Final = 5
#: Student's t that chance exceeds in 1 % of cases (two-sided), by degrees of freedom (any table of
#: the distribution); beyond, the last is used, which is too strict by little.
_T: Final = {1: 63.66, 2: 9.92, 3: 5.84, 4: 4.60, 5: 4.03, 6: 3.71, 8: 3.36, 10: 3.17, 18: 2.88}


@dataclass(frozen=True, eq=False)
class BySubject:
    """Of one metric of one method: (S,) sums over each subject's frames and counts of defined ones.

    frames: (S,) all frames, those where the metric is undefined included.
    """

    sums: _Array
    counts: _Array
    frames: _Array

    @property
    def mean(self) -> float:
        """Over all frames where it is defined; NaN if nowhere."""
        return float(self.sums.sum() / self.counts.sum()) if self.counts.sum() else float("nan")

    @property
    def undefined(self) -> int:
        """Frames where it is not."""
        return int(self.frames.sum() - self.counts.sum())


def interval(values: BySubject, level: float = 0.95) -> tuple[float, float]:
    """Percentile bootstrap interval of the mean over subjects drawn anew; NaN for fewer than 2."""
    subjects = len(values.sums)
    if np.count_nonzero(values.counts) < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(_SEED)
    times = rng.multinomial(subjects, np.full(subjects, 1 / subjects), _DRAWS).astype(np.float64)
    sums, counts = times @ values.sums, times @ values.counts
    means = sums[counts > 0] / counts[counts > 0]
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def sign_flip(first: BySubject, second: BySubject) -> float:
    """Two-sided p of "no difference" between the subjects' means of two methods; NaN if under 2.

    With n subjects it cannot be below 2 / 2^n.
    """
    both = (first.counts > 0) & (second.counts > 0)
    if np.count_nonzero(both) < 2:
        return float("nan")
    difference = first.sums[both] / first.counts[both] - second.sums[both] / second.counts[both]
    n = len(difference)
    observed = abs(float(difference.sum()))
    # Sums that are equal but for rounding are equal.
    observed -= 1e-9 * float(np.abs(difference).sum())
    extreme = np.abs(_signs(n) @ difference) >= observed
    if n <= _EXACT:
        return float(np.mean(extreme))
    return float((1 + np.count_nonzero(extreme)) / (1 + _FLIPS))


@lru_cache(maxsize=4)
def _signs(n: int) -> _Array:
    """(R, n) of +1 and -1: all there are, or _FLIPS random ones, the same each time."""
    if n <= _EXACT:
        return np.array(list(itertools.product((1.0, -1.0), repeat=n)))
    return np.where(np.random.default_rng(_SEED).integers(0, 2, (_FLIPS, n)) > 0, 1.0, -1.0)


def holm(p_values: _Array) -> _Array:
    """(N,) corrected p values, NaN stays."""
    known = np.flatnonzero(~np.isnan(p_values))
    order = known[np.argsort(p_values[known], kind="stable")]
    corrected = p_values.copy()
    factors = len(known) - np.arange(len(known))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(p_values[order] * factors))
    return corrected


def student_t(first: Sequence[float], second: Sequence[float]) -> tuple[float, float]:
    """Student's t of two groups with a common variance, and what chance exceeds in 1 % of cases.

    NaN for fewer than three values together, or where the difference is 0/0.
    """
    freedom = len(first) + len(second) - 2
    if freedom < 1 or not first or not second:
        return math.nan, math.nan
    means = statistics.fmean(first), statistics.fmean(second)
    squares = sum((v - means[0]) ** 2 for v in first) + sum((v - means[1]) ** 2 for v in second)
    error = math.sqrt(squares / freedom * (1 / len(first) + 1 / len(second)))
    difference = means[0] - means[1]
    t = difference / error if error else (0.0 if difference == 0 else math.inf)
    return t, _T[max(known for known in _T if known <= freedom)]
