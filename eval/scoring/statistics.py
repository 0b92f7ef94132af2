"""Means over frames, their confidence intervals, and tests of differences between methods.

Frames of one subject are alike, so the bootstrap (Efron 1979) resamples subjects and the sign-flip
test (Fisher 1935) swaps subjects; p values are corrected for the number of methods (Holm 1979).
scipy.stats.bootstrap returns NaN if one draw lacks all frames of a metric, and scoring needs no
extra.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

#: Bootstrap repetitions; chosen, intervals vary by less than a tenth of their width.
_DRAWS: Final = 2000
#: Most subjects of which the test tries all sign flips; beyond, it tries _FLIPS random ones.
_EXACT: Final = 14
_FLIPS: Final = 20_000
_SEED: Final = 5


@dataclass(frozen=True, eq=False)
class SubjectSums:
    """One metric of one method for S subjects.

    Attributes:
        sums: (S,) sums over the frames where the metric is defined.
        counts: (S,) numbers of these frames.
        frames: (S,) numbers of all frames.

    """

    sums: _Array
    counts: _Array
    frames: _Array

    @property
    def mean(self) -> float:
        """Mean over all frames where the metric is defined; NaN without any."""
        return float(self.sums.sum() / self.counts.sum()) if self.counts.sum() else float("nan")

    @property
    def undefined(self) -> int:
        """Number of frames where the metric is undefined."""
        return int(self.frames.sum() - self.counts.sum())


def bootstrap_interval(values: SubjectSums, level: float = 0.95) -> tuple[float, float]:
    """Return the percentile bootstrap interval of the mean; NaN for fewer than 2 subjects."""
    if np.count_nonzero(values.counts) < 2:
        return float("nan"), float("nan")
    times = resampled(len(values.sums))
    sums, counts = times @ values.sums, times @ values.counts
    means = sums[counts > 0] / counts[counts > 0]
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def ratio_interval(
    first: SubjectSums, second: SubjectSums, level: float = 0.95
) -> tuple[float, float, float]:
    """Return the ratio of two means over the same S subjects, and its bootstrap interval.

    Both means of a draw are over the same subjects. NaN where a mean is undefined or the second is
    0, and for the interval of fewer than 2 subjects.
    """
    ratio = first.mean / second.mean if second.mean else float("nan")
    if min(np.count_nonzero(first.counts), np.count_nonzero(second.counts)) < 2:
        return ratio, float("nan"), float("nan")
    times = resampled(len(first.sums))
    # (a / b) / (c / d) as a d / (b c): the zeros of a draw are found before it divides.
    above = (times @ first.sums) * (times @ second.counts)
    below = (times @ second.sums) * (times @ first.counts)
    if not (below > 0).any():
        return ratio, float("nan"), float("nan")
    ratios = above[below > 0] / below[below > 0]
    low, high = np.quantile(ratios, [(1 - level) / 2, (1 + level) / 2])
    return ratio, float(low), float(high)


def resampled(subjects: int) -> _Array:
    """Return the (_DRAWS, S) counts of S subjects in each draw of a bootstrap."""
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(subjects, np.full(subjects, 1 / subjects), _DRAWS).astype(np.float64)


def sign_flip_test(first: SubjectSums, second: SubjectSums) -> float:
    """Return the two-sided p of equal means of two methods; NaN for fewer than 2 subjects.

    With n subjects p is at least 2 / 2^n.
    """
    both = (first.counts > 0) & (second.counts > 0)
    if np.count_nonzero(both) < 2:
        return float("nan")
    difference = first.sums[both] / first.counts[both] - second.sums[both] / second.counts[both]
    n = len(difference)
    observed = abs(float(difference.sum()))
    # Sums that differ by rounding only count as equal.
    observed -= 1e-9 * float(np.abs(difference).sum())
    extreme = np.abs(_signs(n) @ difference) >= observed
    if n <= _EXACT:
        return float(np.mean(extreme))
    return float((1 + np.count_nonzero(extreme)) / (1 + _FLIPS))


@lru_cache(maxsize=4)
def _signs(n: int) -> _Array:
    """Return (R, n) signs, +1 or -1: all combinations, or for many n a fixed random sample."""
    if n <= _EXACT:
        return np.array(list(itertools.product((1.0, -1.0), repeat=n)))
    return np.where(np.random.default_rng(_SEED).integers(0, 2, (_FLIPS, n)) > 0, 1.0, -1.0)


def holm_correction(p_values: _Array) -> _Array:
    """Return (N,) p values corrected by Holm's method; NaN stays NaN."""
    known = np.flatnonzero(~np.isnan(p_values))
    order = known[np.argsort(p_values[known], kind="stable")]
    corrected = p_values.copy()
    factors = len(known) - np.arange(len(known))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(p_values[order] * factors))
    return corrected
