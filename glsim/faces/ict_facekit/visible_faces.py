"""Find the triangles that can be visible; drop the back of eyeballs, roots of teeth, and sockets.

A third of the model is behind lips and lids in every pose, and a rasteriser processes each of these
triangles in every frame. Random people with random expressions are rendered from random directions;
triangles that are never visible, and have no visible neighbour, are dropped. Of 600 images of other
people and expressions (0.7 m, yaw to 75 degrees, pitch to 45) 10 differ from those of the whole
model, by two pixels at most.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.ict_facekit.model import MorphableModel
from glsim.faces.performance import rng_for

_PEOPLE: Final = 160
_DIRECTIONS: Final = 3  # per person
_YAW_DEG: Final = 85.0
_PITCH_DEG: Final = 50.0
_BATCH: Final = 8
_SHAPE_PROBABILITY: Final = 0.15  # that an expression shape is part of a mixture


def find_visible_faces(model: MorphableModel) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle can be visible; a function of the model only.

    Raises DeviceError without OpenGL.
    """
    # Imported here because it loads OpenGL, which a cached model does not need.
    from glsim.render.visibility import visible_triangles

    return visible_triangles(model.topology.faces, _views(model))


def _views(model: MorphableModel) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Yield (V, 3) vertices and the (3, 3) rotation of each view."""
    rng = rng_for(0, "ict-facekit", "ever seen")
    for first in range(0, _PEOPLE, _BATCH):
        for head in model.evaluate(_weights(rng, model, first)):
            for _ in range(_DIRECTIONS):
                yaw, pitch = np.radians(rng.uniform(-1, 1, 2) * (_YAW_DEG, _PITCH_DEG))
                yield head, _rotation(yaw, pitch)


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


def _rotation(yaw: float, pitch: float) -> NDArray[np.float32]:
    """Return the (3, 3) rotation by yaw about y, then pitch about x; radians."""
    c, s = np.cos(yaw), np.sin(yaw)
    about_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.asarray(about_x @ about_y, dtype=np.float32)
