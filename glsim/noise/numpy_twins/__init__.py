"""NumPy twins of the shader stages: the oracles of their tests, and a path without GL.

A twin does the same float32 arithmetic in the same order, mostly with the shader's names. Results
differ only as a driver's log, cos, acos, pow and division differ from NumPy's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Final

import numpy as np

from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins import (
    any_camera,
    edges,
    signal,
    stereo,
    tof_decode,
    tof_fast,
    tof_light,
    tof_multipath,
    tof_smooth,
    tof_taps,
    values,
    window,
)
from glsim.noise.numpy_twins.layers import Image, Parameters

Twin = Callable[[StageView, Layers, Mapping[str, float]], dict[str, Image]]


def _twin(stage: Callable[[StageView, Layers, Parameters], dict[str, Image]]) -> Twin:
    """Wrap a stage: parameter values become float32, as a shader gets them."""

    @wraps(stage)
    def run(view: StageView, layers: Layers, p: Mapping[str, float]) -> dict[str, Image]:
        return stage(view, layers, {name: np.float32(value) for name, value in p.items()})

    return run


#: Name of the stage (stem of its GLSL file) -> twin.
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
        stereo.stereo_light,
        stereo.stereo_exposure,
        stereo.pattern_light,
        stereo.pattern_exposure,
        tof_light.tof_shadow,
        tof_light.tof_light,
        tof_taps.tof_taps,
        tof_decode.tof_bilateral,
        tof_smooth.tof_smooth,
        tof_smooth.field_stop,
        tof_decode.tof_unwrap,
        tof_decode.tof_edge,
        tof_decode.tof_floor,
        tof_fast.tof_fast,
        tof_multipath.tof_multipath,
        any_camera.any_camera_edges,
        any_camera.any_camera_noise,
        any_camera.any_camera_losses,
    )
}
