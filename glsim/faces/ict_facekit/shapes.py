"""The kit's blend shapes of an expression: its names end in _L and _R instead of Left and Right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.action_units import SHAPES, shape_weights

#: Lips part: 4 mm of the 42 of the kit's jawOpen.
_OVERRIDES: Final = {"AU25": {"jawOpen": 0.1}}
#: Shapes of the midline whose names have a side.
_WHOLE: Final = ("jawLeft", "jawRight")


def kit_name(shape: str) -> str:
    """Return the kit's name of an ARKit shape."""
    for side in () if shape in _WHOLE else ("Left", "Right"):
        if shape.endswith(side):
            return f"{shape.removesuffix(side)}_{side[0]}"
    return shape


#: All shapes that an action unit uses.
KNOWN_SHAPES: Final = frozenset(map(kit_name, SHAPES))


def kit_weights(expression: Mapping[str, float], shapes: Sequence[str]) -> NDArray[np.float64]:
    """Return (E,) weights in [0, 1] of the kit's E shapes for action unit -> intensity."""
    weights = np.zeros(len(shapes))
    for name, weight in shape_weights(expression, _OVERRIDES).items():
        weights[shapes.index(kit_name(name))] = weight
    return weights
