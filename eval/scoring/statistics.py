"""Means over frames, and their confidence intervals.

Frames of one subject are alike, so the bootstrap (Efron 1979) resamples subjects.
scipy.stats.bootstrap is not used: it returns NaN if a draw lacks all frames of a metric, and SciPy
would be another dependency.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from glsim.core.array_types import Array

#: Number of bootstrap draws. Chosen: intervals vary by less than a tenth of their width.
_DRAWS: Final = 2000
_SEED: Final = 5


@dataclass(frozen=True, eq=False)
class SubjectSums:
    """Sums of one metric of one method for each of S subjects, over frames where it is defined.

    ``counts`` has the numbers of these frames, ``frames`` of all.
    """

    sums: Array
    counts: Array
    frames: Array

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
    sums, counts = times @ values.sums, times @ values.counts
    low, high = np.quantile(sums[counts > 0] / counts[counts > 0], [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True)
class PairedDifference:
    """The mean of one method minus that of another, over the same subjects.

    Both methods have the same subjects in each draw of the 95 % interval. In ``lower`` of all
    subjects the one method has the lower mean.
    """

    mean: float
    low: float
    high: float
    lower: int
    subjects: int


def paired_difference(one: SubjectSums, other: SubjectSums) -> PairedDifference:
    """Compare two methods over the subjects where both are defined."""
    both = (one.counts > 0) & (other.counts > 0)
    sums = np.stack([one.sums, other.sums], axis=1)[both]
    counts = np.stack([one.counts, other.counts], axis=1)[both]
    lower = int(np.count_nonzero(np.diff(sums / counts) > 0))
    if len(sums) < 2:
        gap = one.mean - other.mean
        return PairedDifference(gap, float("nan"), float("nan"), lower, len(sums))
    mean = -float(np.diff(sums.sum(axis=0) / counts.sum(axis=0))[0])
    times = resampled(len(sums))
    low, high = np.quantile(-np.diff((times @ sums) / (times @ counts)), [0.025, 0.975])
    return PairedDifference(mean, float(low), float(high), lower, len(sums))


def resampled(subjects: int) -> Array:
    """Draw bootstrap samples of S subjects: (_DRAWS, S) counts of each subject in each draw."""
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(subjects, np.full(subjects, 1 / subjects), _DRAWS).astype(np.float64)
