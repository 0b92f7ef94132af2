"""Bias over distance: the mean error of a method per 100 mm of the truth's depth.

A denoiser whose error depends on distance has learnt a device's systematic error (or makes one).
The pixels are those of the interior where the method and its input have depth; errors beyond
FLYING_MM are no bias but wrong measurements, which ``flying_px`` counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import Depth
from glsim.eval.metrics.prediction import FLYING_MM, Truth
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval

#: Width of a bin, mm.
BIAS_BIN_MM: Final = 100
#: Pixels from which a bin counts for the largest bias. Noise of 1.2 mm that is alike in about 5
#: neighbouring pixels leaves 0.04 mm of a mean over so many; chosen.
ENOUGH_PIXELS: Final = 5000

#: Bin's lower edge, mm, as text (for JSON) -> sum of errors, mm, and number of pixels.
BinSums = dict[str, list[float]]
#: Method -> subject -> bins.
BiasSums = dict[str, dict[str, BinSums]]


@dataclass(frozen=True)
class BiasBin:
    """The bias of a method in one bin of distance.

    from_mm: the bin's lower edge. mean_mm: mean over pixels of prediction - truth; low_mm, high_mm:
    its 95 % interval, bootstrap over subjects, NaN for fewer than 2.
    """

    from_mm: int
    mean_mm: float
    low_mm: float
    high_mm: float
    pixels: int
    subjects: int

    @property
    def is_enough(self) -> bool:
        """Whether the bin has the pixels to count for the largest bias."""
        return self.pixels >= ENOUGH_PIXELS


def bias_bins(depth: NDArray[np.floating] | Depth, truth: Truth) -> BinSums:
    """Return the sums of errors and the pixels of a frame's bins. depth: (H, W) mm, 0 = none.

    Bins are by the distance from the camera; by the map's own depth if that is not known.
    """
    error = depth - truth.clean
    pixels = (depth > 0) & truth.input_valid & truth.parts["interior"]
    pixels &= np.abs(error) <= FLYING_MM
    distance_mm = truth.clean[pixels] + np.nan_to_num(truth.offset_mm)
    place = (distance_mm / BIAS_BIN_MM).astype(np.int64)
    sums, counts = np.bincount(place, weights=error[pixels]), np.bincount(place)
    return {
        str(number * BIAS_BIN_MM): [float(sums[number]), int(counts[number])]
        for number in np.flatnonzero(counts).tolist()
    }


def add_bias(total: BiasSums, method: str, subject: str, bins: Mapping[str, list[float]]) -> None:
    """Add the bins of a method on a subject, in place."""
    known = total.setdefault(method, {}).setdefault(subject, {})
    for edge, (error, pixels) in bins.items():
        before = known.get(edge, [0.0, 0])
        known[edge] = [before[0] + error, before[1] + pixels]


def bias_by_distance(subjects: Mapping[str, BinSums]) -> list[BiasBin]:
    """Return a method's bins, near to far. subjects: subject -> bins."""
    result = []
    for edge in sorted({int(edge) for bins in subjects.values() for edge in bins}):
        both = np.array([bins.get(str(edge), [0.0, 0]) for bins in subjects.values()], np.float64)
        values = SubjectSums(both[:, 0], both[:, 1], both[:, 1])
        low, high = bootstrap_interval(values)
        seen = int(np.count_nonzero(both[:, 1]))
        result.append(BiasBin(edge, values.mean, low, high, int(both[:, 1].sum()), seen))
    return result


def largest_bias(bins: Iterable[BiasBin]) -> BiasBin | None:
    """Return the bin with the largest |bias| of those with ENOUGH_PIXELS; None without any."""
    return max((b for b in bins if b.is_enough), key=lambda b: abs(b.mean_mm), default=None)
