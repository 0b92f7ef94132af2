"""Leaves out what nobody ever sees: the back of the eyeballs, the roots of teeth, the sockets.

A third of the model lies behind lips and lids in every pose, and a rasteriser pays for each of
these triangles in every frame. Random people with random expressions are looked at from random
directions; what is never shown, nor beside what is shown, goes. Of 600 pictures of other people
and expressions (0.7 m, yaw to 75 degrees, pitch to 45) 10 differ from the whole model's, by two
pixels at most.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.performance import rng_for

if TYPE_CHECKING:
    from glsim.faces.ict_facekit.model import Model

_PEOPLE: Final = 160
_DIRECTIONS: Final = 3  # of each
_YAW_DEG: Final = 85.0
_PITCH_DEG: Final = 50.0
_BATCH: Final = 8
_PROBABILITY: Final = 0.15  # of an expression shape to take part in a mixture


def seen_faces(model: Model) -> NDArray[np.bool_]:
    """(F,) whether a triangle of the model can come into view. A function of the model alone."""
    # Here, for it loads OpenGL, and a cached model needs none.
    from glsim.visibility import ever_seen

    return ever_seen(model.topology.faces, _views(model))


def _views(model: Model) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    rng = rng_for(0, "ict-facekit", "ever seen")
    for first in range(0, _PEOPLE, _BATCH):
        for head in model.evaluate(_weights(rng, model, first)):
            for _ in range(_DIRECTIONS):
                yaw, pitch = np.radians(rng.uniform(-1, 1, 2) * (_YAW_DEG, _PITCH_DEG))
                yield head, _turn(yaw, pitch)


def _weights(rng: np.random.Generator, model: Model, first: int) -> NDArray[np.float32]:
    """People at random; the first have one shape each at full strength, the others mixtures."""
    shapes = len(model.expressions)
    modes = len(model.basis) - 1 - shapes
    weights = np.zeros((_BATCH, len(model.basis)), dtype=np.float32)
    weights[:, 0] = 1.0
    weights[:, 1 : 1 + modes] = np.clip(rng.standard_normal((_BATCH, modes)), -3, 3)
    mixed = rng.random((_BATCH, shapes)) * (rng.random((_BATCH, shapes)) < _PROBABILITY)
    for row in range(_BATCH):
        if first + row < shapes:
            mixed[row] = np.eye(shapes)[first + row]
    mixed[1::2, model.expressions.index("jawOpen")] = rng.random(_BATCH // 2)
    weights[:, 1 + modes :] = mixed
    return weights


def _turn(yaw: float, pitch: float) -> NDArray[np.float32]:
    c, s = np.cos(yaw), np.sin(yaw)
    about_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.asarray(about_x @ about_y, dtype=np.float32)
