"""The 68 landmarks of a face: which vertices of a source's meshes they are.

The order is that of Multi-PIE (and iBUG): jaw 0-16, brows 17-26, nose 27-35, eyes 36-47, lips
48-67; each part starts at the side of the subject's right, the left side of the image.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.products import product
from glsim.faces.base import FaceSource

LANDMARKS: Final = 68


def landmark_vertices(source: FaceSource) -> NDArray[np.int64]:
    """Return (68,) indices of vertices, the same in each mesh of the source.

    Raises ConfigError for a source that does not know them.
    """
    topology = source.topology
    if topology is None or topology.landmarks is None:
        raise ConfigError(
            f"{source.name}: does not know the landmarks of its faces: leave output.landmarks out, "
            "or use procedural, people or ict-facekit"
        )
    return topology.landmarks


def to_camera(vertices_mm: NDArray[np.float32], view: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move (N, 3) vertices of a head, mm, by a (4, 4) view to camera-frame metres."""
    return product(vertices_mm.astype(np.float64), view[:3, :3].T) + view[:3, 3]
