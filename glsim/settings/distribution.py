"""A number in the settings that is constant or sampled from a distribution.

    base_sigma_mm = 1.5                              always 1.5
    base_sigma_mm = { uniform = [1, 3] }             one sample per frame
    yaw_deg = { normal = [0, 15], per = "sequence" } one sample per sequence
    octaves = { choice = [1, 2, 4] }
    sigma_px = { loguniform = [0.1, 1] }
    sigma_mm = { uniform = [1.0, 1.3], per = "device" }

The first device of a plan is the typical one: its numbers are the medians of their distributions.

A sample is a function of its key and name only: adding a distribution changes no other sample.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, model_validator

from glsim.core.seeds import keyed_rng
from glsim.settings.toml_tables import KINDS, TomlTable

Scope = Literal["frame", "sequence", "subject"]
#: Scope of a sample; only numbers of a sensor are sampled per device.
DrawScope = Literal[Scope, "device"]


class Distribution(TomlTable):
    """A uniform, loguniform, normal, choice or constant distribution; sampled once per ``per``."""

    constant: float | None = None
    uniform: tuple[float, float] | None = None
    loguniform: tuple[float, float] | None = None
    normal: tuple[float, float] | None = None
    choice: tuple[float, ...] | None = None
    per: DrawScope = "frame"

    @model_validator(mode="after")
    def _check(self) -> Distribution:
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise ValueError(f"give exactly one of {', '.join(KINDS)}, not {kinds or 'none'}")
        values = self._numbers()
        if not all(math.isfinite(v) for v in values):
            raise ValueError("numbers must be finite")
        if self.choice is not None and not self.choice:
            raise ValueError("choice needs at least one number")
        for bounds in (self.uniform, self.loguniform):
            if bounds is not None and bounds[0] > bounds[1]:
                raise ValueError(f"the range {list(bounds)} is empty: low comes first")
        if self.loguniform is not None and self.loguniform[0] <= 0:
            raise ValueError("loguniform needs numbers above 0")
        if self.normal is not None and self.normal[1] < 0:
            raise ValueError("normal = [mean, standard deviation] needs a deviation of at least 0")
        return self

    def _numbers(self) -> tuple[float, ...]:
        values = (getattr(self, kind) for kind in KINDS)
        numbers = next(n for n in values if n is not None)
        return numbers if isinstance(numbers, tuple) else (numbers,)

    @property
    def is_constant(self) -> bool:
        """Whether all samples are equal."""
        return self.constant is not None

    def bounds(self) -> tuple[float, float]:
        """Return the smallest and largest sample; a normal one is cut at 3 standard deviations."""
        if self.normal is not None:
            mean, sigma = self.normal
            return mean - 3 * sigma, mean + 3 * sigma
        return min(self._numbers()), max(self._numbers())

    @property
    def typical(self) -> float:
        """The median of the distribution, or the first number of a choice."""
        if self.uniform is not None:
            return 0.5 * (self.uniform[0] + self.uniform[1])
        if self.loguniform is not None:
            return math.sqrt(self.loguniform[0] * self.loguniform[1])
        return self._numbers()[0]

    def sample(self, keys: ScopeSeeds, name: str) -> float:
        """Sample the number of the setting ``name`` by the seeds of a frame."""
        if self.constant is not None:
            return self.constant
        key = getattr(keys, self.per)
        if key is None:
            return self.typical
        rng = keyed_rng(key, name)
        if self.uniform is not None:
            return float(rng.uniform(*self.uniform))
        if self.loguniform is not None:
            return float(np.exp(rng.uniform(*np.log(self.loguniform))))
        if self.normal is not None:
            mean, sigma = self.normal
            return mean + sigma * float(np.clip(rng.standard_normal(), -3, 3))
        return float(rng.choice(self._numbers()))


class ScopeSeeds(NamedTuple):
    """64-bit seeds of a frame, its sequence, subject and device; None for the typical device."""

    frame: int
    sequence: int
    subject: int
    device: int | None = None


def _from_number(value: object) -> object:
    if not isinstance(value, bool | int | float):
        return value
    try:
        return {"constant": float(value)}
    except OverflowError:  # an integer of hundreds of digits is no float
        raise ValueError("the number is too large") from None


#: Pydantic type of a Distribution; a bare number in a file or an option becomes a constant.
NumberSetting = Annotated[Distribution, BeforeValidator(_from_number)]


def constant(value: float) -> Distribution:
    """Return the distribution that always gives ``value``."""
    return Distribution(constant=value)
