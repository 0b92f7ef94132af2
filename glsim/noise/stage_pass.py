"""Draw one shader stage on the GPU, and set its uniforms."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from operator import attrgetter
from weakref import WeakValueDictionary

import moderngl

from glsim.core.errors import ConfigError
from glsim.gl.draw import FullscreenPass
from glsim.gl.program import link
from glsim.gl.shader_source import ShaderSource
from glsim.gl.targets import Target, TargetPool
from glsim.noise.frame_context import FrameContext
from glsim.noise.layer_names import BLANK
from glsim.render.silhouette import Silhouette

#: Uniform that is no layer -> function of the frame that gives its value.
BOUND: dict[str, Callable[[FrameContext], object]] = {
    f"u_{name}": attrgetter(name)
    for name in (
        "seed", "sequence_seed", "device_seed", "time_s", "focal_baseline_px_m", "emitter_m",
        "modulation_mhz", "supersample", "focal_px", "nearest_m", "subject_m", "projector_tan",
        "second_view_m",
    )
} | {
    "u_frame_size_px": attrgetter("width", "height"),
    "u_emitter_1_m": lambda view: view.emitters_m[0],
    "u_emitter_2_m": lambda view: view.emitters_m[1],
    "u_imager_1_m": lambda view: view.imagers_m[0],
    "u_imager_2_m": lambda view: view.imagers_m[1],
    "u_lens_upper": attrgetter("lens.k1", "lens.k2", "lens.k3"),
    "u_lens_lower": attrgetter("lens.k4", "lens.k5", "lens.k6"),
}  # fmt: skip


class LinkedStages:
    """A cache of the linked stages of one GL context; a stage lives as long as a chain uses it."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._passes = WeakValueDictionary[tuple[str, str, tuple[str, ...]], StagePass]()

    def stage_pass(self, name: str, source: ShaderSource) -> StagePass:
        """Return the linked stage of a name and a source; link a new one. Raises ShaderError."""
        key = (name, source.text, tuple(layer.name for layer in source.writes))
        found = self._passes.get(key)
        # Equal texts have equal declarations, but messages name the file, which may differ.
        if found is None or found.source.file != source.file:
            found = StagePass(self._context, name, source)
            self._passes[key] = found
        return found


class StagePass:
    """A linked shader stage: it reads layers and draws the layers that it declares."""

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
        self, pool: TargetPool, layers: Mapping[str, Target], frame: FrameContext,
        values: Mapping[str, float], within: Silhouette | None = None,
    ) -> dict[str, Target]:  # fmt: skip
        """Draw the frame's window; return name -> written layer. Raises ConfigError.

        The caller gives the returned targets back. Pixels outside ``within`` are skipped.
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
        whole, written = within is None, self.source.writes
        targets = [pool.take(layer, frame.window, clean=whole) for layer in written]
        if within is None:
            self._pass.draw(pool.framebuffer(targets), targets[0].drawn)
        else:
            with within.limits(targets, frame.window, BLANK):
                self._pass.draw()
        return {target.layer.name: target for target in targets}

    def _set(self, name: str, value: object) -> None:
        """Set a uniform. Raises ConfigError if its type in the shader cannot hold the value."""
        try:
            self._program[name] = value
        except (TypeError, struct.error):
            raise ConfigError(
                f"stage {self.name!r}: the shader declares {name} with a type that cannot hold "
                f"{value!r}: see glsim stages and the shipped shaders for its type"
            ) from None
