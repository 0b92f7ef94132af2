"""Find the triangles of a head that can be visible: the rest is behind lips and lids in every pose.

Heads with random expressions are drawn from random directions; triangles that no image shows, and
that have no neighbour in one, are dropped. A rasteriser would process each of them in every frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.pose import rotation
from glsim.core.products import product

#: Largest angles of the directions. Chosen: more than cameras see of a face.
_YAW_DEG: Final = 85.0
_PITCH_DEG: Final = 50.0


def find_visible_faces(
    faces: NDArray[np.int32],
    heads: Iterable[NDArray[np.float32]],
    rng: np.random.Generator,
    directions: int,
    pitch_sign: float = 1.0,
) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle can be visible.

    Args:
        faces: (F, 3).
        heads: (V, 3) vertices of each head, millimetres.
        rng: draws the directions; ``heads`` may draw from it too, before its next head.
        directions: views of each head.
        pitch_sign: -1 reverses the drawn pitch.

    Raises:
        DeviceError: there is no OpenGL.
    """
    # Imported here because it loads OpenGL, which a cached model does not need.
    from glsim.render.visibility import visible_triangles

    def views() -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        for head in heads:
            for _ in range(directions):
                yaw, pitch = rng.uniform(-1, 1, 2) * (_YAW_DEG, _PITCH_DEG)
                turn = product(rotation(0.0, pitch_sign * float(pitch)), rotation(float(yaw)))
                yield head, turn.astype(np.float32)

    return visible_triangles(faces, views())
