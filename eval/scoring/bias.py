"""Bias over distance: the mean error of a method per 100 mm of the truth's depth.

An error that depends on distance is systematic: the training device or the network causes it. It is
measured in interior pixels where the method and its input have depth. Larger errors than FLYING_MM
are flying pixels, which ``flying_px`` counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.depth_map import FLYING_MM
from glsim.eval.metrics.scored_map import Truth
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval

BIAS_BIN_MM: Final = 100
#: A bin needs this number of pixels to count for the largest bias. Chosen: with noise of 1.2 mm,
#: correlated over 5 neighbours, the mean of the bin then has an error of 0.04 mm.
ENOUGH_PIXELS: Final = 5000

#: Lower edge of a bin in mm, as text for JSON -> [sum of errors in mm, number of pixels].
BinSums = dict[str, list[float]]
#: Method -> subject -> bins.
BiasSums = dict[str, dict[str, BinSums]]


@dataclass(frozen=True)
class BiasBin:
    """The bias of a method from a distance on: the mean of prediction - truth over pixels.

    ``low_mm`` to ``high_mm`` is its 95 % interval over subjects; NaN for fewer than 2.
    """

    from_mm: int
    mean_mm: float
    low_mm: float
    high_mm: float
    pixels: int
    subjects: int

    @property
    def is_enough(self) -> bool:
        """Whether the bin has enough pixels to count for the largest bias."""
        return self.pixels >= ENOUGH_PIXELS


def bias_bins(depth: NDArray[np.floating] | Depth, truth: Truth) -> BinSums:
    """Sum errors and count pixels of a frame by distance bin.

    ``depth``: (H, W) mm, 0 = no depth. Distances are the map's depths if the offset is unknown.
    """
    error = depth - truth.clean
    pixels = (depth > 0) & truth.input_valid & truth.parts["interior"]
    pixels &= np.abs(error) <= FLYING_MM
    distance_mm = truth.clean[pixels] + np.nan_to_num(truth.offset_mm)
    bins = (distance_mm / BIAS_BIN_MM).astype(np.int64)
    sums, counts = np.bincount(bins, weights=error[pixels]), np.bincount(bins)
    return {
        str(number * BIAS_BIN_MM): [float(sums[number]), int(counts[number])]
        for number in np.flatnonzero(counts).tolist()
    }


def add_bias(total: BiasSums, method: str, subject: str, bins: Mapping[str, list[float]]) -> None:
    """Add a frame's bins of distance to the totals: bin -> [sum of errors, mm, pixels]."""
    known = total.setdefault(method, {}).setdefault(subject, {})
    for edge, (error, pixels) in bins.items():
        before = known.get(edge, [0.0, 0])
        known[edge] = [before[0] + error, before[1] + pixels]


def bias_by_distance(subjects: Mapping[str, BinSums]) -> list[BiasBin]:
    """Return the bins of a method, near to far, from subject -> sums of bins."""
    result = []
    for edge in sorted({int(edge) for bins in subjects.values() for edge in bins}):
        both = np.array([bins.get(str(edge), [0.0, 0]) for bins in subjects.values()], np.float64)
        values = SubjectSums(both[:, 0], both[:, 1], both[:, 1])
        low, high = bootstrap_interval(values)
        seen = int(np.count_nonzero(both[:, 1]))
        result.append(BiasBin(edge, values.mean, low, high, int(both[:, 1].sum()), seen))
    return result


def largest_bias(bins: Iterable[BiasBin]) -> BiasBin | None:
    """Return the bin with the largest |bias| among bins with ENOUGH_PIXELS; None without any."""
    return max((b for b in bins if b.is_enough), key=lambda b: abs(b.mean_mm), default=None)
