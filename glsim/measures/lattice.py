"""Search for the lattice of a stereo camera's depths, round(K / n) for integers n.

A stereo matcher delivers disparity in steps (1/32 px in a RealSense D400, 1/8 px in a Kinect V1).
K is the focal length times the baseline times the number of steps per pixel, in units of the depth
files. This constant identifies the camera.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Mask

#: Range of K in the search, in units of the files. Derived: from 18 mm x 190 px in 1 mm units and
#: steps of 1/8 px (27,000) to 95 mm x 650 px in 0.1 mm units and 1/32 px (20 million).
LEAST_CONSTANT, MOST_CONSTANT = 2.5e4, 2.5e7
#: A depth is informative if it would lie on the lattice by chance with less than this probability.
_TELLING = 0.7
#: Share of depths that may miss the lattice for other reasons, such as files from several cameras.
_STRAY = 0.02
#: Number of depths in the search; the result is computed from all depths.
_SEARCHED = 150
#: Largest distance of a depth from its level, file units: half a step by rounding, and a margin.
_TOLERANCE = 0.5 + 1e-6
#: Smallest share of informative depths on an accepted lattice, and smallest number of them; chosen.
LEAST_ON_LATTICE, LEAST_TELLING = 0.97, 12
#: Largest value of 16 bits, where the files clip.
_CLIPPED = 65535
#: Number of candidates searched at once: they take 16 MB.
_CHUNK = 1 << 16


@dataclass(frozen=True)
class Lattice:
    """The discrete depths that a stereo camera can deliver: round(K / n), file units.

    Attributes:
        constant: K, in units of the depth files.
        share: share of the informative depths that lie on the lattice.
        telling: number of different informative depths, which would rarely lie on it by chance.
    """

    constant: float
    share: float
    telling: int

    @property
    def accepted(self) -> bool:
        """Whether the depths lie on this lattice, with enough informative depths."""
        return self.share >= LEAST_ON_LATTICE and self.telling >= LEAST_TELLING


def distinct_values(frames: Iterable[NDArray[np.generic]], unit_mm: float = 1.0) -> Array:
    """Return the sorted distinct values, in file units, of (H, W) depths, mm, 0 or NaN = none."""
    found: set[int] = set()
    for frame in frames:
        steps = np.rint(np.nan_to_num(np.asarray(frame, np.float64)) / unit_mm).astype(np.int64)
        found.update(np.unique(steps).tolist())
    return np.array(sorted(v for v in found if 0 < v < _CLIPPED), np.float64)


def on_lattice(values: Array, constant: float) -> Mask:
    """Mark depths, file units, that equal round(K / n) for a constant K and an integer n >= 1."""
    middle = np.rint(constant / values)
    fits = np.zeros(values.shape, np.bool_)
    for step in (-1, 0, 1):  # the next whole number may round to the value as well
        fits |= np.abs(constant / np.maximum(middle + step, 1.0) - values) <= _TOLERANCE
    return fits


def lattice_share(values: Array, constant: float) -> float:
    """Compute the share of informative values that lie on a lattice; NaN without any."""
    telling = constant / values**2 < _TELLING
    if not telling.any():
        return float("nan")
    return float(on_lattice(values[telling], constant).mean())


def estimate_lattice(values: Array) -> Lattice | None:
    """Estimate the lattice of a recording from its ``distinct_values``; None for too few.

    It has the largest likelihood, accepted or not. Multiples of K fit by chance more often.
    """
    if values.size < LEAST_TELLING:
        return None
    constant = _searched(values)
    telling = values[constant / values**2 < _TELLING]
    if telling.size == 0:
        return Lattice(constant, 0.0, 0)
    # Take the middle of the nearby constants that fit the most values.
    reach = 3.0 / float(telling.max())
    near = constant * (1.0 + np.linspace(-reach, reach, 1201))
    hits = np.zeros(len(near))
    for value in telling:
        hits += _nearest_fits(value, near)
    good = near[hits == hits.max()]
    middle = float(good[len(good) // 2])
    return Lattice(middle, lattice_share(telling, middle), int(telling.size))


def _searched(values: Array) -> float:
    """Search the most likely constant K; its steps are a third of a level at the largest depth."""
    far = np.sort(values)[::-1]
    some = far[np.unique(np.linspace(0, far.size - 1, _SEARCHED).astype(int))]
    logs = np.arange(np.log(LEAST_CONSTANT), np.log(MOST_CONSTANT), 1.0 / (3.0 * float(far[0])))
    best, highest = LEAST_CONSTANT, -np.inf
    for start in range(0, len(logs), _CHUNK):
        constants = np.exp(logs[start : start + _CHUNK])
        likelihood = _likelihood(some, constants)
        place = int(likelihood.argmax())
        if likelihood[place] > highest:
            best, highest = float(constants[place]), float(likelihood[place])
    return best


def _likelihood(values: Array, constants: Array) -> Array:
    """Compute, for K constants, the log likelihood ratio of the depths against chance, (K,)."""
    total = np.zeros(len(constants))
    for value in values:
        chance = np.minimum(constants / value**2, 1.0)
        telling = chance < _TELLING
        fits = _nearest_fits(value, constants)
        with np.errstate(divide="ignore"):
            miss = np.log(_STRAY) - np.log1p(-chance)
        total += np.where(telling, np.where(fits, np.log1p(-_STRAY) - np.log(chance), miss), 0.0)
    return total


def _nearest_fits(value: float, constants: Array) -> Mask:
    """Mark the constants, (K,), whose lattice has a level that rounds to the depth."""
    place = np.maximum(np.rint(constants / value), 1.0)
    return np.asarray(np.abs(constants / place - value) <= _TOLERANCE)
