"""What the surface is off in each part of the face."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .catalogue import METRICS, Metric

#: Column of a region, before "@nose" -> the metric that it is a part of, see ``METRICS``.
OF_REGION: Final = {
    "rmse_mm": "input_interior_rmse_mm",
    "bias_mm": "input_interior_bias_mm",
    "normal_mean_deg": "normal_mean_deg",
}

_Array = NDArray[np.float64]


def column(name: str, region: str) -> str:
    """The name of a region's column."""
    return f"{name}@{region}"


def metrics_with(regions: Iterable[str]) -> dict[str, Metric]:
    """METRICS, and those of each region."""
    of_regions = [
        Metric(column(name, region), whole.unit, whole.better, "regions",
               f"{whole.help}; the part of the face called {region} alone")
        for region in regions
        for name, whole in ((name, METRICS[of]) for name, of in OF_REGION.items())
    ]  # fmt: skip
    return METRICS | {metric.name: metric for metric in of_regions}


class Regions:
    """The parts of the face in a frame: (H, W) uint8 labels, and their names -> numbers."""

    def __init__(self, labels: NDArray[np.uint8], numbers: Mapping[str, int]) -> None:
        self.labels, self.numbers = labels, numbers

    def errors(self, error: _Array, pixels: NDArray[np.bool_]) -> dict[str, float]:
        """Root mean square and mean of (N,) errors at N pixels, by region; NaN where it has none.

        pixels: (H, W), N of them true.
        """
        labels = self.labels[pixels]
        square, mean = _means(error * error, labels), _means(error, labels)
        return {
            column(name, region): float(value)
            for region, number in self.numbers.items()
            for name, value in (("rmse_mm", np.sqrt(square[number])), ("bias_mm", mean[number]))
        }

    def angles(self, angle: _Array, pixels: NDArray[np.bool_]) -> dict[str, float]:
        """Mean of (N,) angles in degrees at N pixels, by region; NaN where it has none."""
        mean = _means(angle, self.labels[pixels])
        return {
            column("normal_mean_deg", region): float(mean[number])
            for region, number in self.numbers.items()
        }


def _means(values: _Array, labels: NDArray[np.uint8]) -> _Array:
    """(256,) means of the values with each label."""
    sums, counts = np.bincount(labels, values, 256), np.bincount(labels, minlength=256)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
