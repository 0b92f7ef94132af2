"""Draw one shader stage on the GPU; bind the uniforms that glsim sets."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from weakref import WeakValueDictionary

import moderngl

from glsim.core.errors import ConfigError
from glsim.gl.draw import FullscreenPass
from glsim.gl.program import link
from glsim.gl.shader_source import ShaderSource
from glsim.gl.targets import Target, TargetPool
from glsim.noise.frame_context import FrameContext, StageView
from glsim.noise.layer_names import BLANK
from glsim.render.silhouette import Silhouette

#: The ``u_`` uniforms other than layers that a stage may declare, and the sources of their values.
BOUND: dict[str, Callable[[StageView], object]] = {
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
    "u_emitter_1_m": lambda view: view.optics.emitters_m[0],
    "u_emitter_2_m": lambda view: view.optics.emitters_m[1],
    "u_imager_1_m": lambda view: view.optics.imagers_m[0],
    "u_imager_2_m": lambda view: view.optics.imagers_m[1],
    "u_subject_m": lambda view: view.optics.subject_m,
    "u_projector_tan": lambda view: view.optics.projector_tan,
    "u_second_view_m": lambda view: view.optics.second_view_m,
    "u_lens_upper": lambda view: (view.optics.lens.k1, view.optics.lens.k2, view.optics.lens.k3),
    "u_lens_lower": lambda view: (view.optics.lens.k4, view.optics.lens.k5, view.optics.lens.k6),
}


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
            self._set(name, BOUND[name](view))
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
