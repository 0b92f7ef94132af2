"""Find the triangles of a person that can be visible: only the head has hidden ones.

Without them the insides of mouth, nose and eyes are dropped; the rest of the body is kept whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.action_units import SHAPES
from glsim.faces.people.identity import sample_identity
from glsim.faces.people.model import BodyModel
from glsim.faces.visible_part import find_visible_faces
from glsim.settings.seeds import rng_for

_PEOPLE: Final = 20
_EXPRESSIONS: Final = 5  # per person: the first ones show each action at full strength once
_DIRECTIONS: Final = 2  # per expression
_ACTION_PROBABILITY: Final = 0.15  # that an action is part of a mixture


def visible_faces(model: BodyModel) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle is kept. Raises DeviceError without OpenGL."""
    rng = rng_for(0, "people", "ever seen")
    elsewhere = (model.faces >= model.rigid).any(axis=1)
    return elsewhere | find_visible_faces(model.faces, _heads(model, rng), rng, _DIRECTIONS)


def _heads(model: BodyModel, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """Yield the (V, 3) vertices of each expression, around the middle of the head."""
    waiting = list(SHAPES)
    for person in range(_PEOPLE):
        rest, _ = model.body(sample_identity(0, f"seen {person}").weights)
        middle = rest[: model.rigid].mean(axis=0)
        for _ in range(_EXPRESSIONS):
            shown = rng.random(len(SHAPES)) < _ACTION_PROBABILITY
            weights = {a: float(rng.random()) for a, on in zip(SHAPES, shown, strict=True) if on}
            weights["jawOpen"] = float(rng.random())
            if waiting:
                weights = {waiting.pop(): 1.0}
            head = rest.copy()
            model.actions.add(head, weights)
            yield head - middle
