"""Run stages on arrays: Python stages after the shaders, or a whole chain by its NumPy twins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.noise.earlier_frames import draws_earlier, earlier_depth, twin_of
from glsim.noise.frame_context import FrameContext, StageView
from glsim.noise.layer_names import EARLIER_LAYER, EXPECTED_LAYER, FINE_LAYERS, INITIAL_LAYERS
from glsim.noise.stage import ENABLED, Stage, StageValues


def array_reach_px(stages: Sequence[Stage], values: StageValues) -> int:
    """Return the distance around a pixel that all array stages in sequence read, pixels."""
    return sum(
        stage.spec.reach_px(values[stage.name])
        for stage in stages
        if stage.spec.function is not None and values[stage.name][ENABLED]
    )


def run_array_stages(
    stages: Sequence[Stage],
    layers: dict[str, NDArray[np.float32]],
    frame: FrameContext,
    values: StageValues,
) -> None:
    """Run the array stages on ``layers``, in place.

    Raises ConfigError for a stage that returns a layer of another shape.
    """
    for number, stage in enumerate(stages):
        if stage.spec.function is not None and values[stage.name][ENABLED]:
            written = dict(stage.spec.function(frame.view(stage.name), layers, values[stage.name]))
            if draws_earlier(stages, number, values):
                written[EARLIER_LAYER] = earlier_depth(stages, number, layers, frame, values)
            _update(stage, layers, written, frame.view(stage.name))


def run_twins(
    stages: Sequence[Stage],
    layers: dict[str, NDArray[np.float32]],
    frame: FrameContext,
    values: StageValues,
) -> None:
    """Run the whole chain on ``layers``, in place, shaders by their NumPy twins.

    Raises ConfigError for a shader without a twin.
    """
    layers |= {fine: layers[name] for fine, name in FINE_LAYERS.items() if fine not in layers}
    for stage in stages:
        if not values[stage.name][ENABLED]:
            continue
        function = stage.spec.function or twin_of(stage)
        if function is None:
            raise ConfigError(
                f"stage {stage.name!r} has no NumPy twin: use --backend egl or osmesa, "
                "or switch it off"
            )
        view = frame.view(stage.name)
        _update(stage, layers, function(view, layers, values[stage.name]), view)


def _update(
    stage: Stage,
    layers: dict[str, NDArray[np.float32]],
    written: Mapping[str, NDArray[np.float32]],
    view: StageView,
) -> None:
    shape = (view.window.height, view.window.width)
    for name, array in written.items():
        if name == EXPECTED_LAYER and EXPECTED_LAYER not in layers:
            continue  # not wanted: this frame's other stages did not compute it
        if name in INITIAL_LAYERS and array.shape[:2] != shape:
            raise ConfigError(
                f"stage {stage.name!r} returned {name!r} of shape {array.shape}, not {shape}"
            )
        layers[name] = np.ascontiguousarray(array, dtype=np.float32)
