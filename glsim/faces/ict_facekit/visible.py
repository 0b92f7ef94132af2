"""Find the triangles of the kit that can be visible: without a third of it.

That drops the back of eyeballs, roots of teeth, and sockets. Of 600 images of other people and
expressions (0.7 m, yaw to 75 degrees, pitch to 45) 10 differ from those of the whole model, by two
pixels at most.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.ict_facekit.model import MorphableModel
from glsim.faces.visible_part import find_visible_faces
from glsim.settings.seeds import rng_for

_PEOPLE: Final = 160
_DIRECTIONS: Final = 3  # per person
_BATCH: Final = 8
_SHAPE_PROBABILITY: Final = 0.15  # that an expression shape is part of a mixture


def visible_faces(model: MorphableModel) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle can be visible. Raises DeviceError without OpenGL."""
    rng = rng_for(0, "ict-facekit", "ever seen")
    heads = _heads(model, rng)
    return find_visible_faces(model.topology.faces, heads, rng, _DIRECTIONS, pitch_sign=-1.0)


def _heads(model: MorphableModel, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    for first in range(0, _PEOPLE, _BATCH):
        yield from model.evaluate(_weights(rng, model, first))


def _weights(rng: np.random.Generator, model: MorphableModel, first: int) -> NDArray[np.float32]:
    """Return weights of ``_BATCH`` random people from number ``first`` on.

    The first people show one expression shape each at full strength, the others mixtures.
    """
    shapes = len(model.expressions)
    modes = len(model.basis) - 1 - shapes
    weights = np.zeros((_BATCH, len(model.basis)), dtype=np.float32)
    weights[:, 0] = 1.0
    weights[:, 1 : 1 + modes] = np.clip(rng.standard_normal((_BATCH, modes)), -3, 3)
    mixed = rng.random((_BATCH, shapes)) * (rng.random((_BATCH, shapes)) < _SHAPE_PROBABILITY)
    for row in range(_BATCH):
        if first + row < shapes:
            mixed[row] = np.eye(shapes)[first + row]
    mixed[1::2, model.expressions.index("jawOpen")] = rng.random(_BATCH // 2)
    weights[:, 1 + modes :] = mixed
    return weights
