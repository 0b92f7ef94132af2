"""Find the triangles of the head that can be visible, to drop the insides of mouth, nose and eyes.

Random people with random expressions are drawn from random directions; triangles of the head that
no image shows, and that have no neighbour in one, are dropped. A rasteriser would process each of
them in every frame. The rest of the body is kept whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.facs import ACTIONS
from glsim.faces.people.identity import sample_identity
from glsim.faces.people.model import BodyModel
from glsim.faces.people.posture import rotation
from glsim.faces.performance import rng_for

_PEOPLE: Final = 20
_EXPRESSIONS: Final = 5  # per person: the first ones show each action at full strength once
_DIRECTIONS: Final = 2  # per expression
_YAW_DEG: Final = 85.0
_PITCH_DEG: Final = 50.0
_ACTION_PROBABILITY: Final = 0.15  # that an action is part of a mixture


def find_visible_faces(model: BodyModel) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle is kept; a function of the model only.

    Raises DeviceError without OpenGL.
    """
    # Imported here because it loads OpenGL, which a cached model does not need.
    from glsim.render.visibility import visible_triangles

    elsewhere = (model.faces >= model.rigid).any(axis=1)
    return elsewhere | visible_triangles(model.faces, _views(model))


def _views(model: BodyModel) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Yield (V, 3) vertices around the head and the (3, 3) rotation of each view."""
    rng = rng_for(0, "people", "ever seen")
    waiting = list(ACTIONS)
    for person in range(_PEOPLE):
        rest, _ = model.body(sample_identity(0, f"seen {person}").weights)
        middle = rest[: model.rigid].mean(axis=0)
        for _ in range(_EXPRESSIONS):
            shown = rng.random(len(ACTIONS)) < _ACTION_PROBABILITY
            weights = {a: float(rng.random()) for a, on in zip(ACTIONS, shown, strict=True) if on}
            weights["jawOpen"] = float(rng.random())
            if waiting:
                weights = {waiting.pop(): 1.0}
            head = rest.copy()
            model.actions.add(head, weights)
            for _ in range(_DIRECTIONS):
                yaw, pitch = rng.uniform(-1, 1, 2) * (_YAW_DEG, _PITCH_DEG)
                turn = rotation(0.0, float(pitch)) @ rotation(float(yaw))
                yield head - middle, turn.astype(np.float32)
