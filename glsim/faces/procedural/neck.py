"""Which part of the bust follows the head's pose (see glsim.faces.neck)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: The lowest y that follows the head entirely, as a function of z (mm): from the nape over the
#: throat to the chin, whose lowest place is that of a wide open mouth.
HEAD_Z = (-160.0, -110.0, -60.0, -25.0, 20.0)
HEAD_Y = (-62.0, -88.0, -106.0, -150.0, -160.0)
NECK_MM = 72.0  # height over which the share falls from 1 to 0; the clavicles stay still


def head_share(vertices_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the share (N,) of the head's pose that each vertex (N, 3) follows: 1 head, 0 trunk."""
    share = np.ones(len(vertices_mm), np.float32)
    low = np.flatnonzero(vertices_mm[:, 1] < HEAD_Y[0])
    top = np.interp(vertices_mm[low, 2], HEAD_Z, HEAD_Y).astype(np.float32)
    t = np.clip((vertices_mm[low, 1] - top) / np.float32(NECK_MM) + np.float32(1.0), 0.0, 1.0)
    share[low] = t * t * (3.0 - 2.0 * t)
    return share
