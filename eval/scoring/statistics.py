"""Means over frames, and their confidence intervals.

Frames of one subject are alike, so the bootstrap (Efron 1979) resamples subjects.
scipy.stats.bootstrap returns NaN if one draw lacks all frames of a metric, and scoring needs no
extra.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]

#: Bootstrap repetitions; chosen, intervals vary by less than a tenth of their width.
_DRAWS: Final = 2000
_SEED: Final = 5


@dataclass(frozen=True, eq=False)
class SubjectSums:
    """Sums of one metric of one method for each of S subjects.

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
        """Mean over all frames where the metric is defined; NaN if it is defined in no frame."""
        return float(self.sums.sum() / self.counts.sum()) if self.counts.sum() else float("nan")

    @property
    def undefined(self) -> int:
        """Number of frames where the metric is undefined."""
        return int(self.frames.sum() - self.counts.sum())


def bootstrap_interval(values: SubjectSums) -> tuple[float, float]:
    """Compute the 95 % percentile bootstrap interval of the mean; NaN for fewer than 2 subjects."""
    if np.count_nonzero(values.counts) < 2:
        return float("nan"), float("nan")
    times = resampled(len(values.sums))
    return _interval(times @ values.sums, times @ values.counts)


def ratio_interval(first: SubjectSums, second: SubjectSums) -> tuple[float, float, float]:
    """Compute the ratio of two means over the same S subjects, and its 95 % bootstrap interval.

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
    return ratio, *_interval(above, below)


def _interval(above: _Array, below: _Array) -> tuple[float, float]:
    """Compute the 2.5 % and 97.5 % quantiles of ratios with a divisor above 0; NaN without any."""
    if not (below > 0).any():
        return float("nan"), float("nan")
    low, high = np.quantile(above[below > 0] / below[below > 0], [0.025, 0.975])
    return float(low), float(high)


def resampled(subjects: int) -> _Array:
    """Draw bootstrap samples of S subjects: (_DRAWS, S) counts of each subject in each draw."""
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(subjects, np.full(subjects, 1 / subjects), _DRAWS).astype(np.float64)
