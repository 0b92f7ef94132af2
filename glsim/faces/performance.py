"""FACS performances: the intensity over time of the action units in a sequence.

Action units are plain strings, "AU12" for both sides, "AU12_L" or "AU12_R" for one side, whatever
the face model. All functions are pure functions of (seed, subject, sequence number).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.seeds import rng_for

#: The table motion.toml, which says what its words mean, and its sources.
MOTION: Final = tomllib.loads(files(__package__).joinpath("motion.toml").read_text("utf-8"))
_TABLE: Final = MOTION["expressions"]
CODES: Final[Sequence[str]] = _TABLE["codes"].split()


def _smootherstep(value: float) -> float:
    """Interpolate from 0 to 1 with zero speed and acceleration at both ends."""
    t = min(max(value, 0.0), 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


@dataclass(frozen=True)
class Curve:
    """The intensity curve of an action unit: its peak in [0, 1], and four times in seconds."""

    peak: float
    start_s: float
    apex_s: float
    release_s: float
    end_s: float

    def at(self, time_s: float) -> float:
        """Compute the intensity, in [0, peak], at a time."""
        rise = _smootherstep((time_s - self.start_s) / (self.apex_s - self.start_s))
        fall = _smootherstep((self.end_s - time_s) / (self.end_s - self.release_s))
        return self.peak * rise * fall


@dataclass(frozen=True)
class Performance:
    """One performed sequence: its FACS code, duration, and a curve for each action unit."""

    code: str
    duration_s: float
    curves: Mapping[str, Curve]

    @property
    def peak_s(self) -> float:
        """Time at which the whole expression is strongest, seconds."""
        latest = max(curve.apex_s for curve in self.curves.values())
        earliest = min(curve.release_s for curve in self.curves.values())
        return 0.5 * (latest + earliest) if latest <= earliest else earliest

    def at(self, time_s: float) -> dict[str, float]:
        """Compute the intensities at a time: action unit -> (0, 1], without inactive units."""
        values = {unit: curve.at(time_s) for unit, curve in self.curves.items()}
        return {unit: value for unit, value in values.items() if value > 0.0}

    def frame_times(self, count: int) -> NDArray[np.float64]:
        """Return evenly spaced frame times (count,) in seconds, one moved to the peak."""
        if count == 1:
            return np.array([self.peak_s])
        times = np.linspace(0.0, self.duration_s, count)
        nearest = 1 if count == 2 else 1 + int(np.argmin(np.abs(times[1:-1] - self.peak_s)))
        times[nearest] = self.peak_s
        return times


def performance_for(seed: int, subject: str, number: int) -> Performance:
    """Draw the performance of ``subject`` in sequence ``number`` (0, 1, ...).

    Each subject has its own order of codes; every code is used once before one repeats.
    """
    order = rng_for(seed, "codes", subject, number // len(CODES)).permutation(len(CODES))
    code = CODES[int(order[number % len(CODES)])]
    rng = rng_for(seed, "performance", subject, number)
    duration = float(rng.uniform(*_TABLE["duration_s"]))
    onset, offset = (
        float(rng.uniform(*_TABLE["onset_share"])),
        float(rng.uniform(*_TABLE["offset_share"])),
    )
    curves: dict[str, Curve] = {}
    for word in code.split("+"):
        number_of_unit = int(word.rstrip("LR"))
        peak = float(rng.uniform(*_TABLE["peak"]))
        curve = _curve(rng, number_of_unit, peak, duration, onset, offset)
        unequal = rng.random() < _TABLE["asymmetric_share"]
        weaker = 1.0 - float(rng.uniform(0.0, _TABLE["asymmetry"]))
        left_weaker = rng.random() < 0.5
        unit = f"AU{number_of_unit}"
        if word[-1] in "LR":
            curves[f"{unit}_{word[-1]}"] = curve
        elif unequal and number_of_unit in _TABLE["two_sided"]:
            for side, is_weaker in (("L", left_weaker), ("R", not left_weaker)):
                scale = weaker if is_weaker else 1.0
                curves[f"{unit}_{side}"] = replace(curve, peak=peak * scale)
        else:
            curves[unit] = curve
    return Performance(code, duration, curves)


def _curve(
    rng: np.random.Generator, unit: int, peak: float, duration: float, onset: float, offset: float
) -> Curve:
    """Draw the curve of one action unit; ``onset`` and ``offset`` are common to all units."""
    delay = float(rng.uniform(0.0, _TABLE["delay_share"]))
    early = float(rng.uniform(0.0, _TABLE["delay_share"]))
    if unit == 45:
        length, middle = float(rng.uniform(*_TABLE["blink_s"])), 0.5 * duration
        start, end = middle - length / 3, middle + 2 * length / 3
        return Curve(1.0, start, middle, middle + 0.02, end)
    shares = delay, delay + onset, 1.0 - offset - early, 1.0 - early
    return Curve(peak, *(duration * share for share in shares))


def sequence_name(number: int, performance: Performance) -> str:
    """Return the path-safe name of a sequence, unique for its subject, such as "s03_1+2+5"."""
    return f"s{number:02d}_{performance.code}"


def sequence_number(name: str) -> int:
    """Parse the number in a name made by ``sequence_name``. Raises ValueError otherwise."""
    head, _, code = name.partition("_")
    if not (head.startswith("s") and head[1:].isdigit() and code):
        raise ValueError(f"{name!r} is not a sequence name such as 's03_1+2'")
    return int(head[1:])
