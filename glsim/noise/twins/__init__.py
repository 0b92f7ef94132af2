"""Twins of the shader stages: NumPy references for tests, and a simulator without OpenGL.

A twin does the same float32 arithmetic in the same order, mostly with the shader's names. Results
differ only where a driver's log, cos, acos, pow or division differs from NumPy's. All twins except
the two of structured light also take batches of maps as PyTorch tensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from glsim.core.seeds import stage_seed
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins import any_camera, edges, single_view, stereo, tof_decode, tof_light, values
from glsim.noise.twins.layers import Image, Layers, normal_pair, pixels, random_bits, uniform01

#: The functions that twins of a user's own stages need: docs/howto/noise_stage.md.
__all__ = [
    "find_twin",
    "normal_pair",
    "pixels",
    "random_bits",
    "stage_seed",
    "takes_tensors",
    "uniform01",
]

Twin = Callable[[FrameContext, Layers, Mapping[str, Any]], dict[str, Image]]

_MODULES = (values, edges, stereo, tof_light, tof_decode, any_camera, single_view)

#: Stages whose twins index single dots, which is written for NumPy only.
_NUMPY_ONLY = ("correlation_window", "dot_spread")


def takes_tensors(stage: str) -> bool:
    """Return whether the twin of a shader stage takes batches of maps as tensors."""
    return stage not in _NUMPY_ONLY and not hasattr(stereo, stage) and find_twin(stage) is not None


def find_twin(stage: str) -> Twin | None:
    """Return the twin of a shader stage by the stem of its GLSL file, else None."""
    module = next((m for m in _MODULES if hasattr(m, stage)), None)
    if module is None:
        return None
    twin: Twin = getattr(module, stage)

    def run(view: FrameContext, layers: Layers, p: Mapping[str, Any]) -> dict[str, Image]:
        # Parameter values become float32, the type that a shader gets.
        if not view.batched:
            with np.errstate(under="ignore"):
                return twin(view, layers, {name: np.float32(value) for name, value in p.items()})
        return twin(view, layers, p)

    return run
