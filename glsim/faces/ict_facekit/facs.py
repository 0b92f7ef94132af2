"""Map facial action units to ICT-FaceKit blend shapes.

It follows the table in the kit's README, with these differences: AU10 (upper lip raiser) is
mouthUpperUp, as in ARKit's own description, where the README has mouthShrugUpper; AU11 is half of
it; AU17 (chin raiser) also pushes the upper lip up, so half of mouthShrugUpper is added. AU25 to
AU27 are jawOpen at three intensities, AU34 is cheekPuff like AU33, and AU43 is a long AU45.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, did_you_mean

_PAIRED_SHAPES: Final = {  # action unit -> shapes that exist as _L and _R -> weight
    "AU1": {"browInnerUp": 1.0},
    "AU2": {"browOuterUp": 1.0},
    "AU4": {"browDown": 1.0},
    "AU5": {"eyeWide": 1.0},
    "AU6": {"cheekSquint": 1.0},
    "AU7": {"eyeSquint": 1.0},
    "AU9": {"noseSneer": 1.0},
    "AU10": {"mouthUpperUp": 1.0},
    "AU11": {"mouthUpperUp": 0.5},
    "AU12": {"mouthSmile": 1.0},
    "AU13": {"mouthSmile": 0.5, "cheekPuff": 0.3},  # sharp lip puller: corners up, cheeks full
    "AU14": {"mouthDimple": 1.0},
    "AU15": {"mouthFrown": 1.0},
    "AU16": {"mouthLowerDown": 1.0},
    "AU20": {"mouthStretch": 1.0},
    "AU23": {"mouthPress": 0.5},  # lip tightener: no shape of its own
    "AU24": {"mouthPress": 1.0},
    "AU33": {"cheekPuff": 1.0},
    "AU34": {"cheekPuff": 1.0},
    "AU43": {"eyeBlink": 1.0},
    "AU44": {"eyeSquint": 1.0},
    "AU45": {"eyeBlink": 1.0},
    "AU46": {"eyeBlink": 1.0},  # wink: give the side
    "AU63": {"eyeLookUp": 1.0},
    "AU64": {"eyeLookDown": 1.0},
}
_SINGLE_SHAPES: Final = {  # action unit -> shapes without paired sides -> weight
    "AU17": {"mouthShrugLower": 1.0, "mouthShrugUpper": 0.5},
    "AU18": {"mouthPucker": 1.0},
    "AU22": {"mouthFunnel": 1.0},
    "AU25": {"jawOpen": 0.1},  # lips part: 4 mm of the 42 of jawOpen
    "AU26": {"jawOpen": 0.5},  # jaw drop: relaxed
    "AU27": {"jawOpen": 1.0},  # mouth stretch: pulled wide
    "AU28": {"mouthRollLower": 1.0, "mouthRollUpper": 1.0},
    "AU29": {"jawForward": 1.0},
    "AU30_L": {"jawLeft": 1.0},
    "AU30_R": {"jawRight": 1.0},
    "AU61": {"eyeLookOut_L": 1.0, "eyeLookIn_R": 1.0},  # eyes turn to the subject's left
    "AU62": {"eyeLookOut_R": 1.0, "eyeLookIn_L": 1.0},
}

_COMPETING: Final = ("mouthPucker", "mouthFunnel")  # both push the lips out: their sum is at most 1


def known_units() -> list[str]:
    """Return all supported action units; paired ones also accept _L or _R."""
    return [*_PAIRED_SHAPES, *_SINGLE_SHAPES]


def known_shapes() -> set[str]:
    """Return all blend shapes that an action unit uses."""
    return {shape for unit in known_units() for shape in shapes_of(unit)}


def shapes_of(unit: str) -> dict[str, float]:
    """Return blend shape -> weight at full intensity. ``unit`` is "AU12", "AU12_L" or "AU12_R".

    Raises ConfigError for an action unit without a shape in the model.
    """
    if unit in _SINGLE_SHAPES:
        return dict(_SINGLE_SHAPES[unit])
    name, _, side = unit.partition("_")
    if name in _PAIRED_SHAPES and side in ("", "L", "R"):
        sides = [side] if side else ["L", "R"]
        return {f"{shape}_{s}": w for shape, w in _PAIRED_SHAPES[name].items() for s in sides}
    if name in _SINGLE_SHAPES and side in ("L", "R"):
        return dict(_SINGLE_SHAPES[name])  # the midline has no sides
    raise ConfigError(
        f"{unit}: ICT-FaceKit has no shape for this action unit "
        f"({did_you_mean(unit, known_units())})"
    )


def shape_weights(
    expression: Mapping[str, float], expressions: Sequence[str]
) -> NDArray[np.float64]:
    """Return (E,) weights in [0, 1] of the model's shapes for action unit -> intensity.

    expressions: names of the E shapes. A shape takes the largest weight among its action units, not
    their sum. The weights of mouthPucker and mouthFunnel are scaled to a sum of at most 1.
    """
    index = {name: number for number, name in enumerate(expressions)}
    weights = np.zeros(len(expressions))
    for unit, intensity in expression.items():
        for shape, weight in shapes_of(unit).items():
            weights[index[shape]] = max(weights[index[shape]], weight * intensity)
    competing = [index[shape] for shape in _COMPETING if shape in index]
    weights[competing] /= max(1.0, float(weights[competing].sum()))
    return np.clip(weights, 0.0, 1.0)
