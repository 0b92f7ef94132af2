"""Surface errors in each region of a face, such as the nose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array

#: Name of a region metric without its "@nose" -> metric of the whole frame, in ``METRICS``.
REGION_METRICS: Final = {
    "rmse_mm": "input_interior_rmse_mm",
    "bias_mm": "input_interior_bias_mm",
    "normal_mean_deg": "normal_mean_deg",
}


class Regions:
    """Face regions of a frame: (H, W) uint8 labels, and the label of each region name."""

    def __init__(self, labels: NDArray[np.uint8], numbers: Mapping[str, int]) -> None:
        self.labels, self.numbers = labels, numbers

    def errors(self, error: Array, pixels: NDArray[np.bool_]) -> dict[str, float]:
        """Return RMSE and bias of each region by column name; NaN for a region without pixels.

        ``error``: (N,) mm; ``pixels``: (H, W) mask of the N pixels.
        """
        labels = self.labels[pixels]
        square, mean = _means(error * error, labels), _means(error, labels)
        return {
            f"{name}@{region}": float(value)
            for region, number in self.numbers.items()
            for name, value in (("rmse_mm", np.sqrt(square[number])), ("bias_mm", mean[number]))
        }

    def angles(self, angle: Array, pixels: NDArray[np.bool_]) -> dict[str, float]:
        """Average (N,) angles, degrees, over each region, by column name; NaN without pixels."""
        mean = _means(angle, self.labels[pixels])
        return {f"normal_mean_deg@{r}": float(mean[number]) for r, number in self.numbers.items()}


def _means(values: Array, labels: NDArray[np.uint8]) -> Array:
    """Average the (N,) values of each label: (256,) means; NaN for an absent label."""
    sums, counts = np.bincount(labels, values, 256), np.bincount(labels, minlength=256)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
