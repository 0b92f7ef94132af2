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
    """Sums of one metric of one method for each of S subjects.

    Attributes:
        sums: (S,) sums over the frames where the metric is defined.
        counts: (S,) numbers of these frames.
        frames: (S,) numbers of all frames.
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


def resampled(subjects: int) -> Array:
    """Draw bootstrap samples of S subjects: (_DRAWS, S) counts of each subject in each draw."""
    rng = np.random.default_rng(_SEED)
    return rng.multinomial(subjects, np.full(subjects, 1 / subjects), _DRAWS).astype(np.float64)
