"""Run a sensor's stages over the layers of a frame: shaders on the GPU, then array stages.

``run_twins`` runs the whole chain on arrays instead, with the NumPy twin of each shader.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from weakref import WeakValueDictionary

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, did_you_mean
from glsim.gl.declarations import Layer
from glsim.gl.draw import FullscreenPass
from glsim.gl.program import link
from glsim.gl.shader_source import ShaderSource
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.frame_context import FrameContext, StageView
from glsim.noise.registry import shipped_stages
from glsim.noise.stage import ENABLED, Stage
from glsim.noise.stage_layers import StageLayers
from glsim.reason import Reason
from glsim.render.renderer import Rendered
from glsim.render.silhouette import Silhouette

#: One frame's parameter values: stage name -> parameter -> value.
StageValues = Mapping[str, Mapping[str, float]]

#: The layers that exist before the first stage.
INITIAL_LAYERS = ("clean", "depth", "normal", "albedo", "lit", "reason", "rays", "expected")

#: Layers of rigs that supersample -> the layer bound in their place for other rigs, whose stages do
#: not read it. fine_seen: depth and albedo of the samples; uneven: how much these differ.
FINE_LAYERS = {"fine_seen": "clean", "uneven": "clean"}

#: The map of the device's own fixed pattern, mm, of the whole frame; NO_PATTERN where unknown.
#: Only chains of sensors with a map have it: their shaders see the constant PATTERN_MAP.
PATTERN_LAYER, _PATTERN_CONSTANT = "pattern_map", "PATTERN_MAP"

#: Depth with the device's systematic error and without everything random: clean before the first
#: stage. Stages write it only in chains that need it: their shaders see the constant EXPECTED.
#: tof_light and tof_fast do. The other stages have nothing to add: axial, gaussian, perlin,
#: simplex, lateral, tof_taps and tof_floor are noise with a mean of 0; millimetre_quantise and
#: disparity_quantise round, which noise before them turns into noise; fixed_pattern is a map that
#: differs between pixels, to be removed; dot_spread, correlation_window, max_filter, tof_bilateral
#: and the edges' stages blur, move or drop; haze, bounces (tof_multipath) and light in shadows
#: depend on the scene.
EXPECTED_LAYER, _EXPECTED_CONSTANT = "expected", "EXPECTED"

#: Stands for NaN, which GLSL compilers may assume away: larger than any error.
NO_PATTERN = np.float32(1e6)

#: The layers that a Frame is made of; a chain without an infrared stage has no ``infrared``.
FRAME_LAYERS = ("clean", "depth", "reason", "infrared")

_REASON = Layer("reason", "float")

#: The values other than 0 that sparse stages write in empty pixels.
BLANK = {"reason": float(Reason.NO_SURFACE)}

#: The ``u_`` uniforms other than layers that a stage may declare, and the sources of their values.
_BOUND: dict[str, Callable[[StageView], object]] = {
    "u_seed": lambda view: view.seed,
    "u_sequence_seed": lambda view: view.sequence_seed,
    "u_device_seed": lambda view: view.device_seed,
    "u_time_s": lambda view: view.time_s,
    "u_focal_baseline_px_m": lambda view: view.focal_baseline_px_m,
    "u_frame_size_px": lambda view: (view.width, view.height),
    "u_emitter_m": lambda view: view.optics.emitter_m,
    "u_modulation_mhz": lambda view: view.optics.modulation_mhz,
    "u_supersample": lambda view: view.optics.supersample,
    "u_focal_px": lambda view: view.optics.focal_px,
    "u_nearest_m": lambda view: view.optics.nearest_m,
}


def bound_values(view: StageView) -> dict[str, object]:
    """Return the values of the ``u_`` uniforms other than layers for one stage's view, by name."""
    return {name: value(view) for name, value in _BOUND.items()}


def check_chain(stages: Sequence[Stage], baseline_m: float, where: str) -> None:
    """Raise ConfigError if stages do not fit together or do not fit the rig.

    Args:
        where: the sensor file, for messages.
    """
    layers = {*INITIAL_LAYERS, *FINE_LAYERS, PATTERN_LAYER}
    seen_array_stage: str | None = None
    for stage in stages:
        source = stage.spec.source
        if source is None:
            seen_array_stage = stage.name
            continue
        if seen_array_stage is not None:
            raise ConfigError(
                f"{where}: stage {stage.name!r} is a shader and comes after {seen_array_stage!r}, "
                "which runs on arrays: put array stages last"
            )
        for name in source.reads:
            if name not in layers:
                raise ConfigError(
                    f"{where}: stage {stage.name!r} reads the layer {name!r}, which no stage "
                    f"before it writes ({did_you_mean(name, layers)})"
                )
        for name in source.bound:
            if name not in _BOUND:
                raise ConfigError(
                    f"{source.file}: glsim binds no uniform {name!r} ({did_you_mean(name, _BOUND)})"
                )
        layers |= {layer.name for layer in source.writes}
        if baseline_m == 0 and _needs_baseline(stage, source):
            raise ConfigError(
                f"{where}: stage {stage.name!r} works on disparity, but the rig has no emitter "
                "beside the camera: give it one under [[rig.emitter]]"
            )


def _needs_baseline(stage: Stage, source: ShaderSource) -> bool:
    """Return whether a stage uses disparity; one whose amplitude in px is 0 does not."""
    if "u_focal_baseline_px_m" not in source.bound or stage.settings[ENABLED].bounds()[1] == 0:
        return False
    amplitudes = [stage.settings[n] for n in ("sigma_px", "amplitude_px") if n in stage.settings]
    return not amplitudes or any(a.bounds() != (0.0, 0.0) for a in amplitudes)


class ShaderChain:
    """The shader stages of a sensor, linked for one context.

    Stages whose layers are neither read back nor read by another stage are left out.

    Args:
        infrared, expected: whether to read these layers back.
        extra_layers: further layers to read back.
        pattern_mm: (H, W) map of the device's fixed pattern of the whole frame, NaN = unknown, or
            None.
        linked: stages that other chains of the context have linked; equal ones are taken from
            there.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stages: Sequence[Stage],
        extra_layers: Sequence[str] = (),
        *,
        infrared: bool = True,
        expected: bool = False,
        pattern_mm: NDArray[np.float32] | None = None,
        linked: LinkedStages | None = None,
    ) -> None:
        self._context = context
        linked = linked if linked is not None else LinkedStages(context)
        # Array stages may read any layer; without them only the layers of a Frame are read back.
        wanted: tuple[str, ...] = FRAME_LAYERS if infrared else FRAME_LAYERS[:-1]
        if any(stage.spec.function is not None for stage in stages):
            wanted = (*FRAME_LAYERS, "normal", "albedo", "lit")
        if expected:
            wanted = (*wanted, EXPECTED_LAYER)
        self._wanted: tuple[str, ...] = (*wanted, *extra_layers)
        self._passes: list[StagePass] = []
        needed = set(self._wanted)
        for stage in reversed(stages):
            source = stage.spec.source
            if source is None:
                continue
            if source.uses(_EXPECTED_CONSTANT):
                if EXPECTED_LAYER in needed:
                    source = source.with_defines(**{_EXPECTED_CONSTANT: 1})
                else:
                    source = source.without(EXPECTED_LAYER)
            if needed & {layer.name for layer in source.writes}:
                needed |= set(source.reads)
                if pattern_mm is not None and PATTERN_LAYER in source.reads:
                    source = source.with_defines(**{_PATTERN_CONSTANT: 1})
                self._passes.insert(0, linked.stage_pass(stage.name, source))
        self._pattern: dict[str, Target] = {}
        if pattern_mm is not None:
            layer = Layer(PATTERN_LAYER, "float")
            height, width = pattern_mm.shape
            values = pattern_layer(pattern_mm).tobytes()
            texture = context.texture((width, height), 1, values, dtype="f4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._pattern = {PATTERN_LAYER: Target(texture, layer)}

    def run(
        self,
        rendered: Rendered,
        frame: FrameContext,
        values: StageValues,
        readback: Readback,
        owner: StageLayers | None = None,
    ) -> None:
        """Draw all stages over the rendered layers and queue the readback of the result.

        Args:
            owner: of the targets that the stages draw; default: they are given back at the end.

        Raises:
            ConfigError: a stage that reads a layer of a stage that is switched off.
        """
        owner = owner or StageLayers()
        with owner.run(rendered, frame):
            layers = self._draw(rendered, frame, values, owner)
            wanted = {name: layers[name] for name in self._wanted if name in layers}
            readback.request(rendered.pool, wanted, frame.window)

    def _draw(
        self, rendered: Rendered, frame: FrameContext, values: StageValues, owner: StageLayers
    ) -> dict[str, Target]:
        """Return all layers after the last stage."""
        pool, silhouette = rendered.pool, rendered.silhouette
        layers = {
            **rendered.layers,
            "depth": rendered.layers["clean"],
            EXPECTED_LAYER: rendered.layers["clean"],
            "rays": rendered.rays,
            **self._pattern,
            **owner.draw(_REASON.name, lambda: self._empty_reason(pool, frame)),
        }
        layers |= {fine: layers[n] for fine, n in FINE_LAYERS.items() if fine not in layers}
        # The layers that are blank outside the silhouette. The map is not; where there is no
        # depth it is added to nothing.
        blank = {*layers, PATTERN_LAYER}
        for step in self._passes:
            if not values[step.name][ENABLED]:
                continue
            if sparse := step.source.sparse and blank.issuperset(step.source.reads):
                blank.update(layer.name for layer in step.source.writes)
            else:
                blank.difference_update(layer.name for layer in step.source.writes)
            within = silhouette if sparse and silhouette.skips_empty else None
            of_stage = values[step.name]
            drawn = owner.draw(
                f"stage {step.name}",
                partial(step.draw, pool, layers, frame, of_stage, within),
                *(step, of_stage, within),
                *map(layers.get, step.source.reads),
            )
            owner.replaced(layers[name] for name in drawn if name in layers)
            layers |= drawn
        return layers

    def _empty_reason(self, pool: TargetPool, frame: FrameContext) -> dict[str, Target]:
        """Return the layer ``reason`` before the first stage: 0, for no pixel is lost yet."""
        target = pool.take(_REASON, frame.window)
        buffer = pool.framebuffer([target])
        buffer.use()
        buffer.clear(viewport=frame.window)
        self._context.enable_only(moderngl.NOTHING)
        return {_REASON.name: target}


class LinkedStages:
    """The linked stages of one context, so that a chain with one other stage links one program.

    A stage is kept for as long as a chain has it.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._passes: WeakValueDictionary[tuple[str, str, tuple[str, ...]], StagePass] = (
            WeakValueDictionary()
        )

    def stage_pass(self, name: str, source: ShaderSource) -> StagePass:
        """Return the linked stage of a chain's name and code. Raises ShaderError."""
        key = (name, source.text, tuple(layer.name for layer in source.writes))
        found = self._passes.get(key)
        # The text holds all declarations but not the file that messages name.
        if found is None or found.source.file != source.file:
            found = StagePass(self._context, name, source)
            self._passes[key] = found
        return found


class StagePass:
    """One shader stage: draws the layers that it writes from those that it reads."""

    def __init__(self, context: moderngl.Context, name: str, source: ShaderSource) -> None:
        self.name, self.source = name, source
        self._program = link(context, source)
        self._pass = FullscreenPass(context, self._program)
        self._reads = [n for n in source.reads if f"u_{n}" in self._program]
        for unit, layer in enumerate(self._reads):
            self._set(f"u_{layer}", unit)
        self._bound = [n for n in source.bound if n in self._program]
        self._types = {n: p.type for n, p in source.parameters.items() if n in self._program}
        self._current: dict[str, float] = {}

    def draw(
        self,
        pool: TargetPool,
        layers: Mapping[str, Target],
        frame: FrameContext,
        values: Mapping[str, float],
        within: Silhouette | None = None,
    ) -> dict[str, Target]:
        """Draw the frame's window; return the written layers, by name. Raises ConfigError.

        The caller gives the targets back.

        Args:
            within: skip the pixels outside this silhouette.
        """
        view = frame.view(self.name)
        for name in self._bound:
            self._set(name, _BOUND[name](view))
        for name, kind in self._types.items():
            if self._current.get(name) != values[name]:
                self._set(name, values[name] if kind == "float" else int(values[name]))
                self._current[name] = values[name]
        for unit, name in enumerate(self._reads):
            if name not in layers:
                raise ConfigError(
                    f"stage {self.name!r} reads the layer {name!r}, but the stage that writes it "
                    "is switched off"
                )
            layers[name].texture.use(unit)
        targets = [
            pool.take(layer, frame.window, clean=within is None) for layer in self.source.writes
        ]
        if within is not None:
            with within.limits(targets, frame.window, BLANK):
                self._pass.draw()
            return {target.layer.name: target for target in targets}
        buffer = pool.framebuffer(targets)
        buffer.use()
        assert targets[0].drawn is not None
        buffer.viewport = targets[0].drawn
        self._pass.draw()
        return {target.layer.name: target for target in targets}

    def _set(self, name: str, value: object) -> None:
        """Set a uniform. Raises ConfigError if the shader declares it with another type."""
        try:
            self._program[name] = value
        except (TypeError, struct.error):
            raise ConfigError(
                f"stage {self.name!r}: the shader declares {name} with a type that cannot hold "
                f"{value!r}: see glsim stages and the shipped shaders for its type"
            ) from None


def pattern_layer(pattern_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the layer of a map of the fixed pattern: NO_PATTERN instead of NaN."""
    return np.where(np.isfinite(pattern_mm), pattern_mm, NO_PATTERN).astype(np.float32)


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
    for stage in stages:
        if stage.spec.function is not None and values[stage.name][ENABLED]:
            written = stage.spec.function(frame.view(stage.name), layers, values[stage.name])
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
    from glsim.noise.numpy_twins import TWINS

    layers |= {fine: layers[name] for fine, name in FINE_LAYERS.items() if fine not in layers}
    for stage in stages:
        if not values[stage.name][ENABLED]:
            continue
        # A user's file may have the name of a shipped stage; it has no twin.
        ours = shipped_stages().get(stage.spec.name) is stage.spec
        function = stage.spec.function or (TWINS.get(stage.spec.name) if ours else None)
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
