"""Identity parameters of procedural heads, and the drawing of random identities.

The table parameters.toml has their distributions with sources. Measures of a person are correlated:
each parameter is a weighted sum of the person's factors (``FACTORS``) and an independent random
number. The weights in the table are the correlations with the factors.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from glsim.core.seeds import rng_for

#: Factors of a person, each of mean 0 and sd 1: sex (+1 male, -1 female), size of the body, body
#: fat, age (-1 about 20 years, +2 about 70), and two axes of differences between populations: broad
#: low nose with full lips, and flat midface with a low nasal root and full upper lids.
FACTORS = ("male", "size", "fat", "age", "broad", "flat")


@dataclass(frozen=True)
class IdentityParameter:
    """An identity parameter: a normal distribution clipped to [low, high].

    ``template``: value of the template head; ``loads``: correlations with the FACTORS.
    """

    name: str
    mean: float
    sd: float
    low: float
    high: float
    template: float
    loads: tuple[float, ...]


def _parameter(name: str, row: dict[str, Any]) -> IdentityParameter:
    mean, sd = row["mean"], row["sd"]
    limits = row.get("low", mean - 3 * sd), row.get("high", mean + 3 * sd)
    loads = tuple(row.get(factor, 0.0) for factor in FACTORS)
    return IdentityParameter(name, mean, sd, *limits, row.get("template", mean), loads)


_TABLE = files(__package__).joinpath("parameters.toml").read_text("utf-8")
PARAMETERS = tuple(_parameter(name, row) for name, row in tomllib.loads(_TABLE).items())


def sample_identity(seed: int, subject: str) -> dict[str, float]:
    """Draw a subject's identity: parameter -> value; a pure function of its arguments."""
    rng = rng_for(seed, "identity", subject)
    sex = 1.0 if rng.random() < 0.5 else -1.0
    factors = np.array([sex, *np.clip(rng.standard_normal(len(FACTORS) - 1), -2.0, 2.5)])
    values = {}
    for p in PARAMETERS:
        loads = np.array(p.loads)
        rest = np.sqrt(max(1.0 - float((loads * loads).sum()), 0.0)) * float(rng.standard_normal())
        value = p.mean + p.sd * ((loads * factors).sum() + rest)
        values[p.name] = float(np.clip(value, p.low, p.high))
    return values
