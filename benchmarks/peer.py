"""The interface of the peers' renderers, and constants they share."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.mesh import Mesh
from glsim.geometry.rect import Rect

#: Least distance, m, by which an occluder must be in front of a point to shadow it: the shader's
#: order of magnitude.
SHADOW_BIAS_M = 0.003

#: Maps (mesh, window) to clean depth and lit share within the window, both (h, w) float32.
PeerRenderer = Callable[[Mesh, Rect], tuple[NDArray[np.float32], NDArray[np.float32]]]

#: Makes a context manager that adds its CPU time to the step of this name.
StepTimer = Callable[[str], AbstractContextManager[None]]
