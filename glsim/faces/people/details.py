"""Local changes of the body: the pairs of opposite targets that make people differ.

Each pair is one number: positive values weigh the second target, negative values the first. The
standard deviations are chosen by looking at contact sheets of 64 people: faces differ clearly, and
none looks drawn. Targets that move a part sideways as a whole, sexual details, and pairs that pose
the body rather than shape it are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Pair:
    """Two opposite targets. negative, positive: their files, relative to the targets' folder.

    Args:
        spread: standard deviation of the number that is drawn.
        mirror: for a pair of the left side, name of the pair of the right side that gets nearly the
            same number; else "".
    """

    negative: str
    positive: str
    spread: float
    mirror: str = ""


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
#: Outlines of the head; each person has a share of one. Drawn up to SHAPE_MAX.
HEAD_SHAPES: Final = tuple(
    f"head/head-{shape}"
    for shape in (
        "oval", "round", "rectangular", "square", "triangular", "invertedtriangular", "diamond",
    )
)  # fmt: skip
SHAPE_MAX: Final = 0.4


def _pairs() -> list[Pair]:
    found = []
    for folder, spread, words in _MIDLINE:
        found += [Pair(*_ends(folder, word), spread) for word in words.split()]
    for folder, spread, words in _SIDED:
        for word in words.split():
            left, right = (_ends(folder, f"{side}-{word}") for side in "lr")
            found += [Pair(*left, spread, mirror=right[1]), Pair(*right, spread)]
    for folder, spread, words in _UNEQUAL:
        stems = [f"{folder}/asym-{word}" for word in words.split()]
        found += [Pair(f"{stem}-l", f"{stem}-r", spread) for stem in stems]
    return found


def _ends(folder: str, word: str) -> tuple[str, str]:
    stem, _, ends = word.partition(":")
    low, high = ends.split("/") if ends else ("decr", "incr")
    return f"{folder}/{stem}-{low}", f"{folder}/{stem}-{high}"


PAIRS: Final = tuple(_pairs())

DETAILS: Final = (*(t for pair in PAIRS for t in (pair.negative, pair.positive)), *HEAD_SHAPES)
"""All targets of local changes, relative to the targets' folder."""
