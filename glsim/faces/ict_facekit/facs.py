"""Facial action units as ICT-FaceKit blend shapes.

After the table in the kit's README, with these differences: AU10 (upper lip raiser) is
mouthUpperUp, as in ARKit's own description, where the README has mouthShrugUpper; AU11 is half of
it; AU17 (chin raiser) pushes the upper lip along, so half of mouthShrugUpper is added. AU25 to
AU27 are one jaw at three openings, AU34 is cheekPuff like AU33, and AU43 is a lasting AU45.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, did_you_mean

_SIDED: Final = {  # action unit -> shapes that exist as _L and _R, and how much of each
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
_WHOLE: Final = {  # action unit -> shapes without a side
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

_COMPETING: Final = ("mouthPucker", "mouthFunnel")  # both push the lips out: together at most one


def known_units() -> list[str]:
    """Every action unit that can be shown; those with two sides also take _L or _R."""
    return [*_SIDED, *_WHOLE]


def known_shapes() -> set[str]:
    """Every blend shape that some action unit uses."""
    return {shape for unit in known_units() for shape in shapes_of(unit)}


def shapes_of(unit: str) -> dict[str, float]:
    """Blend shape -> weight at full intensity. ``unit`` is "AU12", "AU12_L" or "AU12_R".

    Raises ConfigError for an action unit the model has no shape for.
    """
    if unit in _WHOLE:
        return dict(_WHOLE[unit])
    name, _, side = unit.partition("_")
    if name in _SIDED and side in ("", "L", "R"):
        sides = [side] if side else ["L", "R"]
        return {f"{shape}_{s}": w for shape, w in _SIDED[name].items() for s in sides}
    if name in _WHOLE and side in ("L", "R"):
        return dict(_WHOLE[name])  # the midline moves as one
    raise ConfigError(
        f"{unit}: ICT-FaceKit has no shape for this action unit "
        f"({did_you_mean(unit, known_units())})"
    )


def shape_weights(
    expression: Mapping[str, float], expressions: Sequence[str]
) -> NDArray[np.float64]:
    """(E,) weights in [0, 1] of the model's shapes, given action unit -> intensity.

    Units that share a shape do not add up: the stronger counts. Pucker and funnel share the lips.
    """
    index = {name: number for number, name in enumerate(expressions)}
    weights = np.zeros(len(expressions))
    for unit, intensity in expression.items():
        for shape, weight in shapes_of(unit).items():
            weights[index[shape]] = max(weights[index[shape]], weight * intensity)
    competing = [index[shape] for shape in _COMPETING if shape in index]
    weights[competing] /= max(1.0, float(weights[competing].sum()))
    return np.clip(weights, 0.0, 1.0)
