"""Run noise stages on NumPy arrays: Python stages after the shaders, or a whole chain by its twins.

Filters over time read the depth of earlier frames of the same still scene. A frame must be the same
if it is simulated alone or in another order. The earlier frames are therefore not the frames before
it in the sequence, but other draws of this frame's noise: the NumPy twin of the exposing stage
exposes the images again, and they are matched again. The device's own properties (dots, pixel
gains, its error) are the same in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from glsim.core.array_types import Floats
from glsim.core.errors import ConfigError
from glsim.core.seeds import stable_seed
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.layer_names import (
    EARLIER_LAYER,
    EXPECTED_LAYER,
    FINE_LAYERS,
    INFRARED,
    INITIAL_LAYERS,
)
from glsim.noise.registry import shipped_stage
from glsim.noise.rig_checks import MATCHER
from glsim.noise.stage import ENABLED, ArrayFunction, Stage, StageValues
from glsim.noise.twins import find_twin, takes_tensors


def array_reach_px(stages: Sequence[Stage], values: StageValues) -> int:
    """Return the distance, pixels, from which the array stages together read neighbours."""
    return sum(
        stage.spec.reach_px(values[stage.name])
        for stage in stages
        if stage.spec.function is not None and values[stage.name][ENABLED]
    )


def run_array_stages(
    stages: Sequence[Stage], layers: dict[str, Floats], frame: FrameContext, values: StageValues, *,
    twins: bool = False,
) -> None:  # fmt: skip
    """Run the array stages on ``layers``, in place.

    With ``twins`` the whole chain is run, and NumPy twins replace the shaders. Raises ConfigError
    for a stage without a twin, or a stage that returns a layer of another shape.
    """
    if twins:
        layers |= {fine: layers[name] for fine, name in FINE_LAYERS.items() if fine not in layers}
    for number, stage in enumerate(stages):
        if not values[stage.name][ENABLED] or not (twins or stage.spec.function):
            continue
        function = stage.spec.function or _twin_of(stage)
        if function is None:
            raise ConfigError(
                f"stage {stage.name!r} has no NumPy twin: use --backend egl or osmesa, "
                "or switch it off"
            )
        view = frame.view(stage.name)
        written = dict(function(view, layers, values[stage.name]))
        if _asked_at(stages, values) == number:
            written[EARLIER_LAYER] = _earlier_depth(stages, number, layers, frame, values)
        shape = (view.window.height, view.window.width)
        for name, array in written.items():
            if name == EXPECTED_LAYER and EXPECTED_LAYER not in layers:
                continue  # no stage computed it, since it was not requested
            if name in INITIAL_LAYERS and array.shape[:2] != shape:
                raise ConfigError(
                    f"stage {stage.name!r} returned {name!r} of shape {array.shape}, not {shape}"
                )
            layers[name] = np.ascontiguousarray(array, dtype=np.float32)


def _twin_of(stage: Stage) -> ArrayFunction | None:
    """Return the NumPy twin of a shipped shader stage; None for a shader file of the user."""
    return find_twin(stage.spec.name) if _is_shipped(stage) else None


def _is_shipped(stage: Stage) -> bool:
    return shipped_stage(stage.spec.name) is stage.spec  # or a user's file of that name


def without_tensors(stages: Sequence[Stage]) -> Stage | None:
    """Return the first enabled stage that does not take PyTorch tensors, else None."""
    for stage in stages:
        lacking = not (_is_shipped(stage) and takes_tensors(stage.spec.name))
        if lacking and stage.settings[ENABLED].bounds()[1] > 0:
            return stage
    return None


def layers_for_earlier(stages: Sequence[Stage]) -> tuple[str, ...]:
    """Return the names of the layers from which earlier frames are exposed; () if not needed."""
    may_run = {s.name: float(s.settings[ENABLED].bounds()[1] > 0) for s in stages}
    asked = _asked_at(stages, {name: {ENABLED: on} for name, on in may_run.items()})
    exposure = None if asked is None else _exposure(stages[:asked])
    return () if exposure is None or exposure.spec.source is None else exposure.spec.source.reads


def _earlier_depth(
    stages: Sequence[Stage], number: int, layers: Layers, frame: FrameContext, values: StageValues
) -> Floats:
    """Simulate the depth of N earlier frames, (h, w, N) m, oldest first. Raises ConfigError."""
    # The seed of the k-th frame before this one is a function of (this frame's seed, k).
    matcher, exposure = stages[number], _exposure(stages[:number])
    twin = None if exposure is None else _twin_of(exposure)
    if exposure is None or twin is None or matcher.spec.function is None:
        raise ConfigError(
            f"earlier frames (for temporal_filter) are exposed by the NumPy twin of the stage that "
            f"writes {INFRARED!r}, and {'it' if exposure is None else exposure.name!r} has none: "
            "switch temporal_filter off, or use glsim.filter_sequence"
        )
    depths = []
    for before in range(int(values[matcher.name]["earlier_frames"]), 0, -1):
        at = replace(frame, seed=stable_seed("earlier frame", frame.seed, before))
        exposed = twin(at.view(exposure.name), layers, values[exposure.name])
        seen: Mapping[str, Floats] = {**layers, **exposed}
        written = matcher.spec.function(at.view(matcher.name), seen, values[matcher.name])
        depths.append(written["depth"])
    return np.stack(depths, axis=-1)


def _asked_at(stages: Sequence[Stage], values: StageValues) -> int | None:
    """Return the index of the matcher if a later stage reads earlier frames, else None."""
    runs = [bool(values[stage.name][ENABLED]) for stage in stages]
    for number, stage in enumerate(stages):
        if stage.spec.name == MATCHER and runs[number]:
            later = zip(stages[number + 1 :], runs[number + 1 :], strict=True)
            if any(on and EARLIER_LAYER in s.spec.array_reads for s, on in later):
                return number
    return None


def _exposure(stages: Sequence[Stage]) -> Stage | None:
    """Return the last shader stage that writes the infrared image; None if no stage does."""
    for stage in reversed(stages):
        source = stage.spec.source
        if source is not None and INFRARED in {layer.name for layer in source.writes}:
            return stage
    return None
