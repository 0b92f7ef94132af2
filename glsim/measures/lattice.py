"""Search for the lattice of a stereo camera's depths, round(K / (n + phase)) for integers n.

A stereo matcher delivers disparity in steps (1/32 px in a RealSense D400, 1/8 px in a Kinect V1).
K is the focal length times the baseline times the number of steps per pixel, in units of the depth
files. This constant identifies the camera. A Kinect V1 counts its steps from a reference plane,
which gives them a phase; that of other cameras is 0.
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
#: A depth is informative if the lattice has fewer levels than this per unit of the files there.
_TELLING = 0.7
#: Number of depths in the search; the result is computed from all depths.
_SEARCHED = 300
#: Reach around the K of the search, as a share. Measured: the search is up to 0.6 % off.
_REACH = 0.01
#: Largest distance of a depth from its level, file units. Measured: a Kinect V1's are up to 0.54
#: off; half a step is rounding.
_TOLERANCE = 0.55
#: Smallest share of informative depths on an accepted lattice, and smallest evidence, the log
#: likelihood ratio against chance. Measured on 220 crops and random depths: true lattices from 13
#: on, chance up to 9.
LEAST_ON_LATTICE, LEAST_EVIDENCE = 0.97, 12.0
#: Smallest number of depths, and of levels between the nearest and the farthest; chosen.
_LEAST_LEVELS = 12
#: Largest value of 16 bits, where the files clip.
_CLIPPED = 65535


@dataclass(frozen=True)
class Lattice:
    """The discrete depths that a stereo camera can deliver: round(K / (n + phase)), file units.

    Attributes:
        constant: K, in units of the depth files.
        phase: 0 to 1.
        share: share of the informative depths that lie on the lattice.
        evidence: log likelihood ratio against chance, of informative depths that all lie on it.
    """

    constant: float
    phase: float
    share: float
    evidence: float

    @property
    def accepted(self) -> bool:
        """Whether the depths lie on this lattice, and not by chance."""
        return self.share >= LEAST_ON_LATTICE and self.evidence >= LEAST_EVIDENCE


def distinct_values(frames: Iterable[NDArray[np.generic]], unit_mm: float = 1.0) -> Array:
    """Return the sorted distinct values, in file units, of (H, W) depths, mm, 0 or NaN = none."""
    found: set[int] = set()
    for frame in frames:
        steps = np.rint(np.nan_to_num(np.asarray(frame, np.float64)) / unit_mm).astype(np.int64)
        found.update(np.unique(steps).tolist())
    return np.array(sorted(v for v in found if 0 < v < _CLIPPED), np.float64)


def on_lattice(values: Array | float, constant: Array | float, phase: float = 0.0) -> Mask:
    """Mark depths, file units, that equal round(K / (n + phase)) for an integer n >= 1."""
    level = np.maximum(np.rint(constant / values - phase), 1.0)
    return np.asarray(np.abs(constant / (level + phase) - values) <= _TOLERANCE)


def estimate_lattice(values: Array) -> Lattice | None:
    """Estimate the lattice of a recording from its ``distinct_values``; None for too few.

    It is the most likely one, accepted or not; with a phase if without one none is accepted.
    """
    if values.size < _LEAST_LEVELS:
        return None
    constant, phase = _searched(values)
    telling = values[constant / values**2 < _TELLING]
    if telling.size == 0:
        return None
    # Take the middle of the nearby constants that fit the most values.
    near = constant * (1.0 + np.arange(-_REACH, _REACH, 0.05 / float(telling.max())))
    hits = np.zeros(near.size)
    for value in telling:
        hits += on_lattice(value, near)
    good = near[hits == hits.max()]
    plain = _judged(telling, float(good[len(good) // 2]))
    if plain.accepted:
        return plain
    for _ in range(3):  # least squares of the depths, whose levels may change with K
        level = np.rint(constant / telling - phase)
        design = np.column_stack([telling, -(telling**2)])
        constant, phase = np.linalg.lstsq(design, level * telling**2)[0]
        if constant < LEAST_CONSTANT:
            return plain
    shifted = _judged(telling, float(constant), float(phase % 1.0))
    return shifted if shifted.accepted else plain


def lattice_of(maps_mm: Iterable[NDArray[np.generic]], step_mm: float) -> Lattice | None:
    """Find the lattice of depths, mm, in files of a step; None without a step or a lattice."""
    found = estimate_lattice(distinct_values(maps_mm, step_mm)) if step_mm > 0 else None
    return found if found is not None and found.accepted else None


def _judged(telling: Array, constant: float, phase: float = 0.0) -> Lattice:
    chance = np.minimum(2.0 * _TOLERANCE * constant / telling**2, 1.0)
    share = float(on_lattice(telling, constant, phase).mean())
    return Lattice(constant, phase, share, float(-np.log(chance).sum()))


def _searched(values: Array) -> tuple[float, float]:
    """Search K and phase of depths K / (n + phase): the strongest period of 1 / depth is 1 / K."""
    some = np.random.default_rng(0).permutation(values)[:_SEARCHED]
    near, far = float(values.min()), float(values.max())
    # Steps of a quarter of a level between the nearest informative depth and infinity.
    constants = np.arange(np.sqrt(LEAST_CONSTANT), np.sqrt(MOST_CONSTANT), 0.15) ** 2
    total, power = np.zeros(constants.size, np.complex128), np.full(constants.size, 1e-9)
    for value in some:
        levels = constants / value**2  # per unit: rounding leaves sinc of the amplitude
        weight = np.where(levels < _TELLING, np.sinc(levels), 0.0)
        total += weight * np.exp(2j * np.pi * constants / value)
        power += weight**2
    seen = constants * (1.0 / np.maximum(np.sqrt(constants / _TELLING), near) - 1.0 / far)
    best = int(np.where(seen >= _LEAST_LEVELS, np.abs(total) ** 2 / power, 0.0).argmax())
    return float(constants[best]), float(np.angle(total[best])) / (2.0 * np.pi)
