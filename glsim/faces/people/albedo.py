"""Reflectivity of people at 860 nm, relative to a white wall (0.85 to 0.9 absolute).

Skin: NIST reflectance data of 100 people (C. C. Cooksey, D. W. Allen, B. K. Tsai, J. Res. NIST 122,
2017): 0.5 to 0.6 at 860 nm, nearly independent of how dark it is to the eye, 0.40 to 0.68 over
people. Hair and brows absorb by their melanin, less than in visible light. The other values are
those of the procedural faces (``glsim.faces.procedural.subject``), where their sources are.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.regions import REGIONS
from glsim.settings.seeds import rng_for

_SKIN: Final = (0.60, 0.045, 0.45, 0.75)  # mean, sd, minimum and maximum over people
_HAIR: Final = (0.20, 0.06, 0.08, 0.32)
_LIPS_TO_SKIN: Final = 0.92
_SHAVEN_TO_SKIN: Final = 0.9  # a scalp without hair: stubble
_PALE: Final = 0.03  # skin varies by this share over the body: blood and sun; chosen
_FIXED: Final = {
    "sclera": 0.50, "iris": 0.20, "pupil": 0.06, "mouth": 0.35, "teeth": 0.60,
}  # fmt: skip


def draw_albedo(seed: int, subject: str, regions: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Draw a subject's (V,) reflectivity in [0, 1]; a pure function of its arguments."""
    rng = rng_for(seed, "people", "albedo", subject)

    def draw(mean: float, sd: float, low: float, high: float) -> float:
        return float(np.clip(rng.normal(mean, sd), low, high))

    skin, hair = draw(*_SKIN), draw(*_HAIR)
    values = {name: skin * (1.0 + float(rng.normal(0.0, _PALE))) for name in REGIONS}
    values |= {"skin": skin, "nose": skin, "lids": skin, "neck": skin}
    values |= {"lips": _LIPS_TO_SKIN * skin, "scalp": _SHAVEN_TO_SKIN * skin, "brow": hair}
    values |= _FIXED
    table = np.array([values[name] for name in REGIONS], dtype=np.float32)
    return np.clip(table, 0.02, 0.95)[regions]
