"""Run the shader stages of a sensor over the layers of a frame, on the GPU."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

import moderngl

from glsim.core.array_types import Floats
from glsim.core.camera import SensorRig
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.shader_source import ShaderSource
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.array_chain import layers_for_earlier
from glsim.noise.frame_context import FrameContext
from glsim.noise.layer_names import (
    EXPECTED_CONSTANT,
    EXPECTED_LAYER,
    FINE_LAYERS,
    FRAME_LAYERS,
    IMAGE_CONSTANTS,
    IMAGER_LAYERS,
    INITIAL_LAYERS,
)
from glsim.noise.stage import ENABLED, Stage, StageValues
from glsim.noise.stage_pass import BOUND, LinkedStages, StagePass
from glsim.render.renderer import Rendered
from glsim.render.sub_frames import LIGHT_LAYERS

_REASON = Layer("reason", "float")


def check_chain(stages: Sequence[Stage], rig: SensorRig, where: str) -> None:
    """Raise ConfigError, with the sensor file, if the stages do not fit each other or the rig."""
    layers = {*INITIAL_LAYERS, *FINE_LAYERS, *IMAGE_CONSTANTS}
    if rig.imagers_m:
        layers |= {n for n in IMAGER_LAYERS if len(rig.imagers_m) > 1 or n.startswith("left")}
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
        for name in (n for n in source.reads if n not in layers):
            why = f"which no stage before it writes ({did_you_mean(name, layers)})"
            if name in IMAGER_LAYERS:
                why = (
                    f"but the rig has {len(rig.imagers_m)} of the imagers that see it: give it one "
                    "more under [[rig.imager]]"
                )
            raise ConfigError(f"{where}: stage {stage.name!r} reads the layer {name!r}, {why}")
        check_uniforms(source)
        layers |= {layer.name for layer in source.writes}
        if rig.baseline_m == 0 and _needs_baseline(stage, source):
            raise ConfigError(
                f"{where}: stage {stage.name!r} works on disparity, but the rig has no emitter "
                "beside the camera: give it one under [[rig.emitter]]"
            )


def check_uniforms(source: ShaderSource) -> None:
    """Check a shader's uniforms. Raises ConfigError for one that nothing sets."""
    for name in source.bound:
        if name not in BOUND:
            raise ConfigError(
                f"{source.file}: glsim binds no uniform {name!r} ({did_you_mean(name, BOUND)})"
            )


def _needs_baseline(stage: Stage, source: ShaderSource) -> bool:
    """Return whether a stage uses disparity; a stage with an amplitude of 0 px does not."""
    if "u_focal_baseline_px_m" not in source.bound or stage.settings[ENABLED].bounds()[1] == 0:
        return False
    amplitudes = [stage.settings[n] for n in ("sigma_px", "amplitude_px") if n in stage.settings]
    return not amplitudes or any(a.bounds() != (0.0, 0.0) for a in amplitudes)


class StageLayers:
    """The textures that the stages of a frame draw into.

    By default a texture returns to its pool when no later stage can read it. With ``kept`` the
    textures stay for the next run over the same rendering, which draws only the stages whose inputs
    differ. A kept texture is reused only after a run without it: no kept stage has read it.
    """

    def __init__(self, *, kept: bool = False) -> None:
        self._kept = kept
        self._over: tuple[Rendered, FrameContext] | None = None
        self._stages: dict[str, tuple[tuple[object, ...], dict[str, Target]]] = {}
        self._used: set[str] = set()
        self._unused: list[Target] = []

    @contextmanager
    def run(self, rendered: Rendered, frame: FrameContext) -> Iterator[None]:
        """Hold the textures that a block draws over ``rendered``, and give them back at its end."""
        if self._over is None or self._over[0] is not rendered or self._over[1] != frame:
            self.clear()
            self._over = rendered, frame
        self._used = set()
        kept = False
        try:
            yield
            kept = self._kept
        finally:
            self._drop([n for n in self._stages if n not in self._used] if kept else None)

    def draw(
        self, name: str, draw: Callable[[], dict[str, Target]], *inputs: object
    ) -> dict[str, Target]:
        """Return the layers of the stage ``name``; draw them again only if its inputs changed.

        ``inputs`` are all values that the layers depend on, besides the rendering and the frame.
        Mappings are compared by value, stages and targets by identity.
        """
        known = self._stages.get(name)
        if known is None or not all(
            one is two or (isinstance(one, Mapping) and one == two)
            for one, two in zip(known[0], inputs, strict=True)
        ):
            drawn = draw()
            self._unused += self._stages.pop(name, ((), {}))[1].values()
            known = self._stages[name] = inputs, drawn
        self._used.add(name)
        return known[1]

    def replaced(self, targets: Iterable[Target]) -> None:
        """Give back textures that a stage has replaced by new ones; with ``kept`` do nothing."""
        gone = () if self._kept else tuple(targets)
        for _, drawn in self._stages.values():
            for layer in [layer for layer, target in drawn.items() if target in gone]:
                self._unused.append(drawn.pop(layer))
        if gone:
            self._give_back()

    def clear(self) -> None:
        """Give all textures back. Call it before the rendering ends."""
        self._drop(None)

    def _drop(self, names: Sequence[str] | None) -> None:
        """Give back the textures of the stages ``names``, or of all stages for None."""
        # In reverse order, so that the next frame takes them in the same order.
        for name in reversed(tuple(self._stages) if names is None else names):
            self._unused += reversed(self._stages.pop(name)[1].values())
        self._give_back()
        if names is None:
            self._over = None

    def _give_back(self) -> None:
        for target in self._unused:
            assert self._over is not None, "drawn within run()"
            self._over[0].pool.give_back(target)
        self._unused = []


class ShaderChain:
    """The shader stages of a sensor, linked for one OpenGL context.

    Stages are left out if their layers are neither read back nor read by another stage.

    Args:
        infrared, expected: whether to read these layers back.
        images: float32 images of a sensor that are the same in every frame, by layer.
        linked: the linked stages of this GL context, used again by further chains.
    """

    def __init__(
        self, context: moderngl.Context, stages: Sequence[Stage], extra_layers: Sequence[str] = (),
        *, infrared: bool = True, expected: bool = False,
        images: Mapping[str, Floats] | None = None, linked: LinkedStages | None = None,
    ) -> None:  # fmt: skip
        self._context = context
        linked = linked if linked is not None else LinkedStages(context)
        # Extra layers are read back for array stages; otherwise only the layers of a Frame.
        wanted: tuple[str, ...] = FRAME_LAYERS if infrared else FRAME_LAYERS[:-1]
        read = [stage.spec.array_reads for stage in stages if stage.spec.function is not None]
        if read:
            read.append(layers_for_earlier(stages))
            wanted = tuple(dict.fromkeys(itertools.chain(FRAME_LAYERS, *read)))
        if expected:
            wanted = (*wanted, EXPECTED_LAYER)
        self._wanted: tuple[str, ...] = (*wanted, *extra_layers)
        self._passes: list[StagePass] = []
        needed = set(self._wanted)
        for stage in reversed(stages):
            source = stage.spec.source
            if source is None:
                continue
            if source.uses(EXPECTED_CONSTANT):
                if EXPECTED_LAYER in needed:
                    source = source.with_defines(**{EXPECTED_CONSTANT: 1})
                else:
                    source = source.without(EXPECTED_LAYER)
            if needed & {layer.name for layer in source.writes}:
                needed |= set(source.reads)
                own = {IMAGE_CONSTANTS[n]: 1 for n in images or {} if n in source.reads}
                source = source.with_defines(**own) if own else source
                self._passes.insert(0, linked.stage_pass(stage.name, source))
        self._images: dict[str, Target] = {}
        for name, values in (images or {}).items():
            height, width = values.shape
            texture = context.texture((width, height), 1, values.tobytes(), dtype="f4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._images[name] = Target(texture, Layer(name, "float"), Rect(0, 0, width, height))

    def run(
        self, rendered: Rendered, frame: FrameContext, values: StageValues, readback: Readback,
        owner: StageLayers | None = None, *, light: Mapping[str, Target] | None = None,
        truth: Mapping[str, Target] | None = None,
    ) -> None:  # fmt: skip
        """Draw all stages over the rendered layers, and queue the copy of the result to memory.

        Raises ConfigError for a stage that reads a layer of a stage that is switched off.

        Args:
            owner: holds the textures of the stages; default: they are given back at the end.
            light: LIGHT_LAYERS of a moving scene, which replace the light stages.
            truth: layers to read back instead of the rendered ones.
        """
        owner = owner or StageLayers()
        with owner.run(rendered, frame):
            layers = self._draw(rendered, frame, values, owner, light=light or {})
            layers |= truth or {}
            wanted = {name: layers[name] for name in self._wanted if name in layers}
            readback.request(rendered.pool, wanted, frame.window)

    @contextmanager
    def light(
        self, rendered: Rendered, frame: FrameContext, values: StageValues
    ) -> Iterator[dict[str, Target]]:
        """Draw a sub-frame up to the last stage that writes light, and yield its LIGHT_LAYERS."""
        owner = StageLayers()
        with owner.run(rendered, frame):
            layers = self._draw(rendered, frame, values, owner, self.light_stages)
            yield {name: layers[name] for name in LIGHT_LAYERS}

    @property
    def light_stages(self) -> int:
        """The number of stages up to the last one that writes light, inclusive."""
        writes = [{layer.name for layer in step.source.writes} for step in self._passes]
        return max((n for n, names in enumerate(writes, 1) if {*LIGHT_LAYERS} & names), default=0)

    def _draw(
        self, rendered: Rendered, frame: FrameContext, values: StageValues, owner: StageLayers,
        stages: int | None = None, light: Mapping[str, Target] | None = None,
    ) -> dict[str, Target]:  # fmt: skip
        """Draw all stages, or the first ``stages``, with replaced ``light``; return all layers."""
        pool, silhouette = rendered.pool, rendered.silhouette
        layers = {
            **rendered.layers,
            "depth": rendered.layers["clean"],
            EXPECTED_LAYER: rendered.layers["clean"],
            "rays": rendered.rays,
            **self._images,
            **owner.draw(_REASON.name, lambda: self._empty_reason(pool, frame)),
        }
        layers |= {fine: layers[n] for fine, n in FINE_LAYERS.items() if fine not in layers}
        # These layers are blank outside the silhouette. The sensor's images are not, but pixels
        # without depth do not use them.
        blank = {*layers, *IMAGE_CONSTANTS}
        for number, step in enumerate(self._passes[:stages]):
            if light and number == self.light_stages:
                layers |= light
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
        """Return the layer ``reason`` before the first stage: all 0, since no pixel is lost yet."""
        target = pool.take(_REASON, frame.window)
        buffer = pool.framebuffer([target])
        buffer.use()
        buffer.clear(viewport=frame.window)
        self._context.enable_only(moderngl.NOTHING)
        return {_REASON.name: target}
