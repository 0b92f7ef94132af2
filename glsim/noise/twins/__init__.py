"""The shader stages in NumPy, one twin each: the oracle of their tests, and a path without GL.

A twin does the same arithmetic in float32, in the same order. Results differ by what a driver's
log, cos, acos, pow and division differ from NumPy's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Final

import numpy as np

from glsim.noise.twins import (
    edges,
    signal,
    tof_decode,
    tof_fast,
    tof_light,
    tof_multipath,
    tof_taps,
    values,
    window,
)
from glsim.noise.twins.layers import Image, Values
from glsim.noise.view import Layers, StageView

Twin = Callable[[StageView, Layers, Mapping[str, float]], dict[str, Image]]


def _twin(stage: Callable[[StageView, Layers, Values], dict[str, Image]]) -> Twin:
    """The stage with the values of its parameters as a shader gets them, in float32."""

    @wraps(stage)
    def run(view: StageView, layers: Layers, p: Mapping[str, float]) -> dict[str, Image]:
        return stage(view, layers, {name: np.float32(value) for name, value in p.items()})

    return run


#: By the stem of the GLSL file.
TWINS: Final[dict[str, Twin]] = {
    stage.__name__: _twin(stage)
    for stage in (
        values.axial,
        values.disparity_quantise,
        values.fixed_pattern,
        values.gaussian,
        values.millimetre_quantise,
        values.perlin,
        values.simplex,
        edges.edge_dropout,
        edges.lateral,
        edges.max_filter,
        signal.infrared,
        signal.low_signal,
        signal.range_gate,
        signal.shadow,
        window.correlation_window,
        window.dot_spread,
        tof_light.tof_shadow,
        tof_light.tof_light,
        tof_taps.tof_taps,
        tof_decode.tof_bilateral,
        tof_decode.tof_unwrap,
        tof_decode.tof_edge,
        tof_decode.tof_floor,
        tof_fast.tof_fast,
        tof_multipath.tof_multipath,
    )
}
