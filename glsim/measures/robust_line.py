"""Fit lines to points of which many may be outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Steps of reweighted least squares, and the residual below which all points weigh alike. Chosen.
_STEPS, _LEAST_RESIDUAL = 30, 0.1


def fit_line(x: Array, y: Array) -> tuple[float, float]:
    """Fit y = offset + slope x by least absolute deviations.

    Up to half of the points may be outliers.

    Args:
        x, y: (N,) coordinates of the points, in any unit.

    Returns:
        Offset, in the unit of y, and slope.
    """
    design = np.column_stack([np.ones_like(x), x])
    weight: Array = np.ones_like(x)
    fit: Array = np.zeros(2)
    for _ in range(_STEPS):
        solved = np.linalg.lstsq(design * weight[:, None], y * weight, rcond=None)
        fit = np.asarray(solved[0], np.float64)
        weight = 1.0 / np.sqrt(np.maximum(np.abs(y - design @ fit), _LEAST_RESIDUAL))
    return float(fit[0]), float(fit[1])
