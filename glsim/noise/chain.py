"""Runs a sensor's stages over the layers of a frame: shaders on the GPU, then array stages.

``run_twins`` runs the whole chain on arrays instead, with the NumPy twin of each shader.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, did_you_mean
from glsim.gl.program import link
from glsim.gl.silhouette import Silhouette
from glsim.gl.source import Layer, ShaderSource
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.stage import ENABLED, Stage, shipped
from glsim.noise.view import FrameContext, StageView
from glsim.reason import Reason
from glsim.render import Renderer

#: Stage name -> parameter -> value, for one frame.
Values = Mapping[str, Mapping[str, float]]

#: The layers that exist before the first stage.
INITIAL_LAYERS = ("clean", "depth", "normal", "albedo", "lit", "reason", "rays")

#: Depth and albedo on the grid of a rig's samples, and how uneven a pixel's are. Where nothing is
#: supersampled there are other layers in their places, which nobody reads.
FINE_LAYERS = {"fine_seen": "clean", "uneven": "clean"}

#: The layers that a Frame is made of; a chain without an infrared stage lacks the last.
FRAME_LAYERS = ("clean", "depth", "reason", "infrared")

_REASON = Layer("reason", "float")

#: What sparse stages write where nothing is seen, other than 0.
_BLANK = {"reason": float(Reason.NO_SURFACE)}

#: The uniforms, besides layers, that a stage may declare, and where their values come from.
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


def check_chain(stages: Sequence[Stage], baseline_m: float, where: str) -> None:
    """Raise ConfigError where stages do not fit together or do not fit the rig."""
    layers = {*INITIAL_LAYERS, *FINE_LAYERS}
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
    """Noise in disparity is optional where it is an amplitude: at 0 it needs no baseline."""
    if "u_focal_baseline_px_m" not in source.bound or stage.settings[ENABLED].bounds()[1] == 0:
        return False
    amplitudes = [stage.settings[n] for n in ("sigma_px", "amplitude_px") if n in stage.settings]
    return not amplitudes or any(a.bounds() != (0.0, 0.0) for a in amplitudes)


class ShaderChain:
    """The shader stages of a sensor, linked for one context.

    infrared: whether the infrared layer is to come back; extra_layers: what else is. A stage whose
    layers nobody reads, and that are not to come back, is left out.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stages: Sequence[Stage],
        extra_layers: Sequence[str] = (),
        *,
        infrared: bool = True,
    ) -> None:
        self._context = context
        # Array stages may read any layer; without them only what a Frame holds comes back.
        wanted: tuple[str, ...] = FRAME_LAYERS if infrared else FRAME_LAYERS[:-1]
        if any(stage.spec.function is not None for stage in stages):
            wanted = (*FRAME_LAYERS, "normal", "albedo", "lit")
        self._wanted: tuple[str, ...] = (*wanted, *extra_layers)
        self._passes: list[StagePass] = []
        needed = set(self._wanted)
        for stage in reversed(stages):
            source = stage.spec.source
            if source is not None and needed & {layer.name for layer in source.writes}:
                self._passes.insert(0, StagePass(context, stage.name, source))
                needed |= set(source.reads)

    def run(
        self,
        renderer: Renderer,
        clean_layers: Mapping[str, Target],
        frame: FrameContext,
        values: Values,
        readback: Readback,
    ) -> None:
        """Draw all stages over the renderer's layers and queue the copy of the result.

        The targets, those of ``clean_layers`` included, go back to the renderer's pool.
        """
        pool = renderer.pool
        layers = {
            **clean_layers,
            "depth": clean_layers["clean"],
            "reason": pool.take(_REASON, frame.window),
            "rays": renderer.rays,
        }
        layers |= {fine: layers[name] for fine, name in FINE_LAYERS.items() if fine not in layers}
        blank = pool.framebuffer([layers["reason"]])
        blank.use()
        blank.clear(viewport=frame.window)
        self._context.enable_only(moderngl.NOTHING)
        bare = set(layers)  # the layers that hold nothing outside the silhouette
        for step in self._passes:
            if not values[step.name][ENABLED]:
                continue
            if sparse := step.source.sparse and bare.issuperset(step.source.reads):
                bare.update(layer.name for layer in step.source.writes)
            else:
                bare.difference_update(layer.name for layer in step.source.writes)
            within = renderer.silhouette if sparse and renderer.silhouette.leaves_out else None
            drawn = step.draw(pool, layers, frame, values[step.name], within)
            for name, target in drawn.items():
                old = layers.get(name)
                layers[name] = target
                if old is not None and not any(old is other for other in layers.values()):
                    pool.give_back(old)
        readback.request(
            pool, {name: layers[name] for name in self._wanted if name in layers}, frame.window
        )
        del layers["rays"]  # stays the renderer's
        for target in {id(target): target for target in layers.values()}.values():
            pool.give_back(target)


class StagePass:
    """One shader stage: a full-window draw from layers to layers."""

    def __init__(self, context: moderngl.Context, name: str, source: ShaderSource) -> None:
        self.name, self.source = name, source
        self._program = link(context, source)
        self._array = context.vertex_array(self._program, [])
        self._reads = [n for n in source.reads if f"u_{n}" in self._program]
        for unit, layer in enumerate(self._reads):
            self._program[f"u_{layer}"] = unit
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
        """Draw the frame's window; the written layers, by name. Raises ConfigError.

        within: skip what lies outside this silhouette.
        """
        view = frame.view(self.name)
        for name in self._bound:
            self._program[name] = _BOUND[name](view)
        for name, kind in self._types.items():
            if self._current.get(name) != values[name]:
                self._program[name] = values[name] if kind == "float" else int(values[name])
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
            with within.limits(targets, frame.window, _BLANK):
                self._array.render(moderngl.TRIANGLES, vertices=3)
            return {target.layer.name: target for target in targets}
        buffer = pool.framebuffer(targets)
        buffer.use()
        assert targets[0].drawn is not None
        buffer.viewport = targets[0].drawn
        self._array.render(moderngl.TRIANGLES, vertices=3)
        return {target.layer.name: target for target in targets}


def array_reach_px(stages: Sequence[Stage], values: Values) -> int:
    """How far around a pixel the array stages look, one after the other, pixels."""
    return sum(
        stage.spec.reach_px(values[stage.name])
        for stage in stages
        if stage.spec.function is not None and values[stage.name][ENABLED]
    )


def run_array_stages(
    stages: Sequence[Stage],
    layers: dict[str, NDArray[np.float32]],
    frame: FrameContext,
    values: Values,
) -> None:
    """Run the array stages, in place. Raises ConfigError for one that returns nonsense."""
    for stage in stages:
        if stage.spec.function is not None and values[stage.name][ENABLED]:
            written = stage.spec.function(frame.view(stage.name), layers, values[stage.name])
            _take(stage, layers, written, frame.view(stage.name))


def run_twins(
    stages: Sequence[Stage],
    layers: dict[str, NDArray[np.float32]],
    frame: FrameContext,
    values: Values,
) -> None:
    """Run the whole chain on arrays, in place. Raises ConfigError for a shader without a twin."""
    from glsim.noise.twins import TWINS

    layers |= {fine: layers[name] for fine, name in FINE_LAYERS.items() if fine not in layers}
    for stage in stages:
        if not values[stage.name][ENABLED]:
            continue
        own = (
            shipped().get(stage.spec.name) is stage.spec
        )  # a user's file may have the name of ours
        function = stage.spec.function or (TWINS.get(stage.spec.name) if own else None)
        if function is None:
            raise ConfigError(
                f"stage {stage.name!r} has no NumPy twin: use --backend egl or osmesa, "
                "or switch it off"
            )
        view = frame.view(stage.name)
        _take(stage, layers, function(view, layers, values[stage.name]), view)


def _take(
    stage: Stage,
    layers: dict[str, NDArray[np.float32]],
    written: Mapping[str, NDArray[np.float32]],
    view: StageView,
) -> None:
    shape = (view.window.height, view.window.width)
    for name, array in written.items():
        if name in INITIAL_LAYERS and array.shape[:2] != shape:
            raise ConfigError(
                f"stage {stage.name!r} returned {name!r} of shape {array.shape}, not {shape}"
            )
        layers[name] = np.ascontiguousarray(array, dtype=np.float32)
