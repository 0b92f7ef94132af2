"""Facial action units of the table action_units.toml: the ARKit blend shapes that show each unit.

Apple's documentation (ARFaceAnchor.BlendShapeLocation) defines the shapes, the FACS manual (P.
Ekman, W. V. Friesen, J. C. Hager, 2002) the action units. ICT-FaceKit's README differs in three
units: AU10 is mouthShrugUpper, AU17 mouthShrugLower alone, AU33 the whole cheekPuff.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Final

from glsim.core.errors import ConfigError, did_you_mean

_TABLE: Final = tomllib.loads(files(__package__).joinpath("action_units.toml").read_text("utf-8"))
_PAIRED: Final[Mapping[str, Mapping[str, float]]] = _TABLE["paired"]
_SINGLE: Final[Mapping[str, Mapping[str, float]]] = _TABLE["single"]
_SIDES: Final = {"L": "Left", "R": "Right"}
_COMPETING: Final = ("mouthPucker", "mouthFunnel")  # both push the lips out: their sum is at most 1

#: Action unit -> (shape -> weight), for a model that differs from the table.
Overrides = Mapping[str, Mapping[str, float]]
_AS_IN_THE_TABLE: Final[Overrides] = {}


def known_units() -> list[str]:
    """Return the names of all supported action units; paired units also accept _L or _R."""
    return [*_PAIRED, *_SINGLE]


def shapes_of(unit: str, overrides: Overrides = _AS_IN_THE_TABLE) -> dict[str, float]:
    """Return the blend shapes of an action unit at full intensity: shape -> weight.

    ``overrides`` are rows of the table that a model replaces. Raises ConfigError without a shape.
    """
    single = {**_SINGLE, **overrides}
    if unit in single:
        return dict(single[unit])
    name, _, side = unit.partition("_")
    if name in _PAIRED and side in ("", *_SIDES):
        sides = [side] if side else list(_SIDES)
        return {f"{shape}{_SIDES[s]}": w for shape, w in _PAIRED[name].items() for s in sides}
    if name in single and side in _SIDES:
        return dict(single[name])  # a shape of the midline has no sides
    raise ConfigError(
        f"{unit}: no blend shape shows this action unit ({did_you_mean(unit, known_units())})"
    )


#: All shapes that action units use, a name for each side, in a fixed order.
SHAPES: Final = tuple(sorted({shape for unit in known_units() for shape in shapes_of(unit)}))


def shape_weights(
    expression: Mapping[str, float], overrides: Overrides = _AS_IN_THE_TABLE
) -> dict[str, float]:
    """Compute the blend-shape weights of an expression: shape -> (0, 1], in the order of SHAPES.

    A shape takes the largest weight among its units, not their sum. The weights of mouthPucker and
    mouthFunnel are scaled to a sum of at most 1. ``overrides``: see ``shapes_of``.
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
