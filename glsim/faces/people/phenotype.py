"""Phenotypes: which targets make a body of a gender, age, muscle, weight, height and so on.

The data hold one target for each combination of extremes, such as
"universal-female-young-maxmuscle-minweight". A body between the extremes is their multilinear
interpolation; this is how MakeHuman and anny define the model.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Final

#: Phenotype -> its extremes and their places in [0, 1]. Babies below one year are left out, and
#: firmness of the breast is always average,
#: with which the average cup is the body of the universal target itself.
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
#: The grown people, man and woman, averaged: what ``refinement``,
#: ``regions`` and ``landmarks`` measure lengths on.
MEAN_PERSON: Final = {
    "gender": 0.5, "age": 2 / 3, "muscle": 0.5, "weight": 0.5, "height": 0.5, "proportions": 0.5,
    "cupsize": 0.5, "african": 1 / 3, "asian": 1 / 3, "caucasian": 1 / 3,
}  # fmt: skip

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


def phenotype_targets() -> dict[str, tuple[str, ...]]:
    """Return file, relative to macrodetails and without suffix -> the extremes it combines."""
    return {
        folder + pattern.format(*extremes): extremes
        for folder, pattern, choices in _BLOCKS
        for extremes in itertools.product(*choices)
    }


def phenotype_weights(values: Mapping[str, float]) -> dict[str, float]:
    """Return target -> weight, without zeros.

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
    """Return extreme -> weight of the piecewise linear interpolation at ``value``."""
    shares = dict.fromkeys(anchors, 0.0)
    names = list(anchors)
    for low, high in itertools.pairwise(names):
        start, end = anchors[low], anchors[high]
        if value <= end or high == names[-1]:
            share = min(max((value - start) / (end - start), 0.0), 1.0)
            shares[low], shares[high] = 1.0 - share, share
            break
    return shares
