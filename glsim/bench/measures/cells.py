"""Values in cells of distance and radius: the tables of noise."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

#: Bounds of the cells: distances, m, and radii, px of a Kinect V2.
DISTANCES_M = (0.45, 0.65, 0.9, 1.2, 1.5, 2.0, 2.6, 3.2, 4.5)
RADII_PX = (0.0, 100.0, 160.0, 210.0, 250.0, 400.0)
#: Least number of pixels of a cell: sigma is then known to 5 %, correlated noise included.
LEAST_PIXELS = 400


@dataclass(frozen=True)
class Cell:
    """A value of the pixels between two distances, m, and two radii, px."""

    distance_m: tuple[float, float]
    radius_px: tuple[float, float]
    value: float
    pixels: int


class Samples:
    """Pixels of several frames: distance (mm), radius (px) and a value each."""

    def __init__(self) -> None:
        self._parts: list[tuple[NDArray[np.float32], ...]] = []

    def add(
        self,
        depth_mm: NDArray[np.floating],
        radius_px: NDArray[np.floating],
        value: NDArray[np.floating],
    ) -> None:
        """Add the pixels whose value is finite."""
        known = np.isfinite(value)
        parts = (depth_mm[known], radius_px[known], value[known])
        self._parts.append(tuple(np.asarray(p, np.float32) for p in parts))

    def root_cells(self) -> tuple[Cell, ...]:
        """Return the root of the mean value in each cell with LEAST_PIXELS."""
        if not self._parts:
            return ()
        depth, radius, value = (np.concatenate(p) for p in zip(*self._parts, strict=True))
        cells = []
        for near, far in pairwise(DISTANCES_M):
            row = (depth >= 1000 * near) & (depth < 1000 * far)
            for inner, outer in pairwise(RADII_PX):
                here = value[row & (radius >= inner) & (radius < outer)]
                if here.size >= LEAST_PIXELS:
                    root = float(np.sqrt(max(float(here.mean(dtype=np.float64)), 0.0)))
                    cells.append(Cell((near, far), (inner, outer), root, int(here.size)))
        return tuple(cells)
