"""Identities: who a subject is, as weights of the model's targets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from glsim.faces.people.details import HEAD_SHAPES, PAIRS, SHAPE_MAX
from glsim.faces.people.phenotype import ORIGINS, phenotype_weights
from glsim.settings.seeds import rng_for

#: Age groups: share of the people, and years. People in front of a camera are mostly grown.
_AGES: Final = ((0.12, 6.0, 15.0), (0.68, 15.0, 60.0), (0.20, 60.0, 85.0))
#: The model's age at these years: its extremes baby, child, young and old on MakeHuman's scale, and
#: nearly grown at 17.
_YEARS: Final = (1.0, 10.0, 17.0, 25.0, 90.0)
_MODEL_AGES: Final = (0.0, 1 / 3, 0.6, 2 / 3, 1.0)
#: Mean, standard deviation, minimum and maximum of the phenotypes; 0.5 is the average body,
#: but its average height is tall: at 0.35 +- 0.06 the grown are 1.73 and 1.63 m on average, +- 0.09
#: (NCD-RisC, eLife 5, 2016: men 1.71, women 1.59 m in the world), and the distance of their pupils
#: is 62 and 60 mm (N. A. Dodgson, Proc. SPIE 5291, 2004: 63, 52 to 78). The rest is chosen.
_BUILD: Final = {
    "muscle": (0.50, 0.17, 0.10, 0.90),
    "weight": (0.52, 0.18, 0.15, 0.95),
    "height": (0.35, 0.06, 0.20, 0.52),
    "proportions": (0.50, 0.20, 0.05, 0.95),
    "cupsize": (0.45, 0.18, 0.05, 0.90),
}
_GENDER_SPREAD: Final = 0.10  # of faces of one gender, as a share of the way to the other
_CONCENTRATION: Final = 0.35  # Dirichlet: most people are mainly of one origin, many are mixed
_LIMIT: Final = 0.95  # targets are made for weights up to 1
_SIDE_SPREAD: Final = 0.07  # difference between the two sides of a face


@dataclass(frozen=True)
class Identity:
    """A person. weights: target -> weight. age_years. woman. phenotype: name -> value in [0, 1]."""

    weights: dict[str, float]
    age_years: float
    woman: bool
    phenotype: dict[str, float]


def sample_identity(seed: int, subject: str) -> Identity:
    """Draw a person; a pure function of (seed, subject)."""
    rng = rng_for(seed, "people", subject)
    share, low, high = zip(*_AGES, strict=True)
    group = int(rng.choice(len(_AGES), p=share))
    years = float(rng.uniform(low[group], high[group]))
    woman = bool(rng.random() < 0.5)
    off = min(abs(float(rng.normal(0.0, _GENDER_SPREAD))), 0.4)
    values = {
        "gender": 1.0 - off if woman else off,
        "age": float(np.interp(years, _YEARS, _MODEL_AGES)),
    }
    for name, (mean, spread, least, most) in _BUILD.items():
        values[name] = float(np.clip(rng.normal(mean, spread), least, most))
    origins = rng.dirichlet([_CONCENTRATION] * len(ORIGINS))
    values |= dict(zip(ORIGINS, (float(share) for share in origins), strict=True))
    weights = phenotype_weights(values)
    for target, weight in _details(rng).items():
        weights[target] = weight
    return Identity(weights, years, woman, values)


def _details(rng: np.random.Generator) -> dict[str, float]:
    """Draw target -> weight of the local changes."""
    drawn: dict[str, float] = {}
    mirrored: dict[str, float] = {}
    for pair in PAIRS:
        value = float(rng.normal(0.0, pair.spread))
        if pair.positive in mirrored:
            value = mirrored[pair.positive] + float(rng.normal(0.0, _SIDE_SPREAD))
        if pair.mirror:
            mirrored[pair.mirror] = value
        value = float(np.clip(value, -_LIMIT, _LIMIT))
        drawn[pair.positive if value > 0 else pair.negative] = abs(value)
    shape = HEAD_SHAPES[int(rng.integers(len(HEAD_SHAPES)))]
    drawn[shape] = float(rng.uniform(0.0, SHAPE_MAX))
    return drawn
