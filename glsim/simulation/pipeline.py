"""The pipeline from settings to frames: the file to read first.

simulate(settings)       opens the sources and the context; per task of the plan, a Simulator runs
    FaceLoader.load      -> faces (meshes in canonical axes, mm), varied and dressed, in batches
    FrameScenes.build    -> the scene: face, pose, room, other people, and the delivered crop
    sample_values        -> stage parameters, sampled with the task's seeds
    MovingFrames.draw    -> instead of the next two lines, if the scene moves in the exposure
    Renderer.render      -> clean, normal, albedo, lit (region on request): GPU targets
    ShaderChain.run      -> depth (noisy), reason, infrared: GPU targets, readback queued
    Readback.arrays      -> the same as float32 arrays
    run_array_stages     -> depth and reason after the Python stages
    register             -> both in the view of the colour camera, if the rig delivers that
    assemble_frame       -> Frame, in the order of the tasks (or Skipped for a bad face)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from moderngl import Context
from numpy.typing import NDArray

from glsim.core.array_types import Floats
from glsim.core.errors import ConfigError, MeshError
from glsim.core.products import product
from glsim.core.seeds import stable_seed
from glsim.faces import open_source
from glsim.faces.face_source import BadFace, Face, FaceSource
from glsim.faces.regions import has_regions, to_camera
from glsim.gl.context import borrowed_context, is_software, make_current
from glsim.gl.targets import Readback
from glsim.noise.array_chain import array_reach_px, run_array_stages
from glsim.noise.chain import ShaderChain
from glsim.noise.frame_context import FrameContext
from glsim.noise.layer_names import INFRARED_RIGHT
from glsim.noise.registry import find_stage, shader_stage
from glsim.noise.stage import ENABLED, sample_values
from glsim.render.region_pass import REGION
from glsim.render.renderer import NORMAL, Rendered, Renderer
from glsim.sensors.sensor import Sensor, StageChange, sensor_of
from glsim.settings.schema import Settings, with_assignments
from glsim.simulation.assembly import assemble_frame, seen_landmarks
from glsim.simulation.color_image import color_image
from glsim.simulation.face_loader import unusable
from glsim.simulation.frame import LAYERS, Frame, Skipped
from glsim.simulation.motion import MovingFrames, exposure_parts, settle_reasons
from glsim.simulation.plan.tasks import Task, make_tasks
from glsim.simulation.registration import register
from glsim.simulation.render_cache import RenderCache
from glsim.simulation.scenes import FrameScene

#: Number of frames between drawing and readback on a GPU, which draws asynchronously. The software
#: rasteriser draws at once: more frames would only add delay.
_RING_ON_GPU = 4


@dataclass(eq=False)
class _InFlight:
    """A frame between drawing and readback.

    ``true`` holds the layers in the colour camera's view; ``rolled`` marks a rolling-shutter frame.
    """

    readback: Readback
    task: Task
    scene: FrameScene
    frame: FrameContext
    values: dict[str, dict[str, float]]
    sampled: dict[str, float]
    true: dict[str, Floats]
    rolled: bool = False


def simulate(
    settings: Settings,
    tasks: Iterable[Task] | None = None,
    *,
    sources: Sequence[FaceSource] | None = None,
    backend: str | None = None,
    context: Context | None = None,
    layers: Collection[str] = LAYERS,
    extra_layers: Sequence[str] = (),
) -> Iterator[Frame | Skipped]:
    """Yield one result per task, in order; by default for the whole Plan of the settings.

    A face that cannot be rendered gives a Skipped.

    Args:
        sources: open face sources, any FaceSource (default: those of ``settings.source``).
        backend: "egl" or "osmesa".
        context: the GL context; by default this thread's.
        layers: the requested images. Without "infrared" that image is 0 unless a stage reads it;
            "regions" (the parts of the face) and "expected" are rendered on request only.
        extra_layers: layers of the stages to copy to ``Frame.extra``.

    Raises:
        ConfigError, ShaderError, DeviceError: the settings or this machine cannot make frames.
        MeshError: a face cannot be rendered, and ``settings.strict`` is set.
    """
    opened = list(sources) if sources is not None else open_sources(settings)
    planned = make_tasks(settings, opened) if tasks is None else tasks
    with nullcontext(context) if context is not None else borrowed_context(backend) as drawn_in:
        yield from Simulator(settings, opened, drawn_in, extra_layers, layers).frames(planned)


def frames(
    settings: Settings, tasks: Iterable[Task] | None = None, **options: Any
) -> Iterator[Frame]:
    """Yield Frames like ``simulate``, with the same options, but never a Skipped.

    Raises MeshError if a face cannot be rendered, even if ``settings.strict`` is False.
    """
    strict = settings.model_copy(update={"strict": True})
    for frame in simulate(strict, tasks, **options):
        assert isinstance(frame, Frame), "a bad face raises, because strict is set"
        yield frame


def open_sources(settings: Settings) -> list[FaceSource]:
    """Open the face sources that the settings name. Raises ConfigError."""
    return [
        open_source(s, stable_seed("source", settings.seed, number))
        for number, s in enumerate(settings.source)
    ]


class Simulator:
    """Makes frames of one sensor on one GL context.

    ``with_values``, ``with_stage`` and ``with_layers`` return another simulator with the same
    sources and context, and do not change this one. Both share the linked programs and the last
    frame, which is drawn again from its first changed stage on.
    """

    def __init__(
        self,
        settings: Settings,
        sources: Sequence[FaceSource],
        context: Context,
        extra_layers: Sequence[str] = (),
        layers: Collection[str] = LAYERS,
        changes: Sequence[StageChange] = (),
        *,
        cache: RenderCache | None = None,
    ) -> None:
        """Compile the shaders of a sensor. Raises ConfigError or ShaderError.

        Args:
            layers, extra_layers: as in ``simulate``.
            changes: stages whose code replaces the code that the sensor's file names.
            cache: cache of another simulator with the same sources and context; default: none.
        """
        self.settings, self._sources, self._extra = settings, sources, tuple(extra_layers)
        self._context, self._layers, self._changes = context, layers, tuple(changes)
        self.sensor: Sensor = sensor_of(settings, changes)
        make_current(context)
        self._cache = cache or RenderCache(context)
        self._canvas = self.sensor.rig.canvas()
        self._renderer = self._cache.renderer(self._canvas)
        self._colour: Renderer | None = None
        if self.sensor.rig.registered is not None:
            self._colour = self._cache.renderer(self.sensor.rig.colour_rig())
            of_depth = {"expected", "infrared_right"} & set(layers) | set(self._extra)
            if of_depth:
                raise ConfigError(
                    f"{settings.sensor}: frames registered to colour have no layer "
                    f"{min(of_depth)!r}: leave it out of output.layers"
                )
        normals = {"normals", "color"} & set(layers) and NORMAL.name not in self._extra
        labelled = "regions" in layers or ("color" in layers and has_regions(sources))
        read_back = (
            *self._extra,
            *((REGION.name,) if labelled and self._colour is None else ()),
            *((INFRARED_RIGHT,) if "infrared_right" in layers else ()),
            *((NORMAL.name,) if normals else ()),
        )
        if "infrared_right" in layers and len(self.sensor.rig.imagers_m) < 2:
            raise ConfigError(
                f"the layer 'infrared_right' needs a stereo camera, not {settings.sensor!r}: leave "
                "it out of output.layers"
            )
        self._chain = ShaderChain(
            context,
            self.sensor.stages,
            read_back,
            infrared="infrared" in layers,
            expected="expected" in layers,
            images=self.sensor.images,
            linked=self._cache.linked,
        )
        self._scenes = self._cache.scenes(settings, sources, self.sensor.rig, regions=labelled)
        ring = 1 if is_software(context) else _RING_ON_GPU
        self._moving: MovingFrames | None = None
        if settings.motion.within_exposure:
            parts = exposure_parts(self.sensor.rig, self._chain, self.sensor.name)
            self._moving = MovingFrames(self._renderer, self._chain, self._cache.sub_frames, parts)
        self._readbacks = [Readback(context) for _ in range(ring)]
        crop = settings.output.crop
        image = self.sensor.rig.delivered
        if crop is not None and crop > min(image.width, image.height):
            raise ConfigError(
                f"output.crop {crop} is larger than the sensor's {image.width}x{image.height}"
            )

    def with_values(self, values: Mapping[str, Any]) -> Simulator:
        """Return a simulator with changed settings, named as in ``--set``.

        For instance {"tof_floor.sigma_mm": 2, "pose.yaw_deg": {"uniform": [-30, 30]}, "seed": 3}.
        Raises ConfigError for an unknown name, for a value out of range, and for a change of the
        source, which needs another Simulator.
        """
        return self._like(settings=with_assignments(self.settings, values))

    def with_stage(self, name: str, code: str | Path, before: str | None = None) -> Simulator:
        """Return a simulator whose stage ``name`` runs other GLSL; only that program is linked.

        Raises ShaderError with file and line; ConfigError if the stage does not fit the chain.

        ``before``: the stage before which a new one is inserted; default: after the last shader.
        """
        known = {stage.name: stage for stage in self.sensor.stages}
        if isinstance(code, Path):
            spec = find_stage(str(code))
        else:
            of_stage = Path(known[name].spec.file) if name in known else Path(f"{name}.glsl")
            spec = shader_stage(of_stage, code)
        previous = next((c.before for c in self._changes if c.name == name), None)
        kept = [change for change in self._changes if change.name != name]
        change = StageChange(name, spec, before or previous)
        settings, known_values = self.settings, {ENABLED, *spec.parameters}
        if name in settings.stage:
            own = {k: v for k, v in settings.stage[name].items() if k in known_values}
            settings = settings.model_copy(update={"stage": {**settings.stage, name: own}})
        return self._like(settings=settings, changes=[*kept, change])

    def with_layers(self, layers: Collection[str], extra_layers: Sequence[str] = ()) -> Simulator:
        """Return a simulator that delivers other layers, with arguments as in ``simulate``."""
        return self._like(layers=layers, extra_layers=extra_layers)

    def _like(self, **changed: Any) -> Simulator:
        settings = changed.pop("settings", self.settings)
        if settings.source != self.settings.source:
            raise ConfigError("source: other faces need another Simulator")
        kept = {"extra_layers": self._extra, "layers": self._layers, "changes": self._changes}
        return Simulator(
            settings, self._sources, self._context, cache=self._cache, **{**kept, **changed}
        )

    def frames(self, tasks: Iterable[Task]) -> Iterator[Frame | Skipped]:
        """Yield one Frame or Skipped per task, in order."""
        in_flight: deque[_InFlight | Skipped] = deque()
        ring = len(self._readbacks)
        for number, (task, face) in enumerate(self._scenes.loader.load_ahead(tasks)):
            if len(in_flight) == ring:
                yield self._deliver(in_flight.popleft())
            in_flight.append(self._start(task, face, self._readbacks[number % ring]))
        while in_flight:
            yield self._deliver(in_flight.popleft())

    def _start(self, task: Task, face: Face | BadFace, readback: Readback) -> _InFlight | Skipped:
        """Queue the drawing of one frame; return a Skipped for a bad face."""
        try:
            if isinstance(face, BadFace):
                raise face.error
            return self._draw(task, face, readback)
        except MeshError as error:
            return self._skipped(task, error)
        except MemoryError as error:
            return self._skipped(task, unusable(task, error))

    def _skipped(self, task: Task, error: MeshError) -> Skipped:
        """Return the Skipped of a bad face. Raises ``error`` if the settings are strict."""
        if self.settings.strict:
            raise error
        return Skipped(task.key, self._sources[task.source].name, str(error))

    def _draw(self, task: Task, face: Face, readback: Readback) -> _InFlight:
        rig, stages = self._canvas, self.sensor.stages
        make_current(self._context)  # the caller may have used another context since the last frame
        scene = self._scenes.build(task, face)
        sampled, values = sample_values(stages, self._scenes.loader.held(task).seeds)
        reach_px = array_reach_px(stages, values)
        crop = self.sensor.rig.on_canvas(scene.crop)

        def frame_of(rendered: Rendered) -> FrameContext:
            return FrameContext.for_frame(
                rig=rig,
                window=rendered.window,
                seed=task.seeds.frame,
                sequence_seed=task.seeds.sequence,
                device_seed=stable_seed("device", self.settings.seed, task.device),
                time_s=task.key.time_s,
                nearest_m=rendered.nearest_m,
                # The depth of the head; beyond the face's depths, the nearest or farthest of these.
                subject_m=float(np.clip(scene.head_to_camera_m[2, 3], *rendered.face_m)),
            )

        if self._moving is not None:
            times_s = [0.001 * part.time_ms for part in self._moving.parts]
            if moved := self._scenes.moved(task, face, times_s):
                sampled |= self._scenes.speeds(task)
                still, *parts = (replace(each, crop=crop) for each in (scene, *moved))
                frame = self._moving.draw(still, parts, reach_px, frame_of, values, readback)
                true = self._seen_in_colour(scene)
                rolls = self._moving.rolls
                return _InFlight(readback, task, scene, frame, values, sampled, true, rolls)
        rendered, owner = self._cache.rendered(self._renderer, scene, crop, reach_px)
        frame = frame_of(rendered)
        self._chain.run(rendered, frame, values, readback, owner)
        return _InFlight(readback, task, scene, frame, values, sampled, self._seen_in_colour(scene))

    def _seen_in_colour(self, scene: FrameScene) -> dict[str, Floats]:
        """Draw the crop of a scene in the colour camera's view; {} if no such view is delivered."""
        colour = self.sensor.rig.registered
        if self._colour is None or colour is None:
            return {}
        turn = colour.from_depth()
        meshes = [(mesh, product(turn, view).astype(np.float32)) for mesh, view in scene.meshes]
        with self._colour.render(meshes, labels=scene.labels, window=scene.crop) as rendered:
            names = ["clean", *(["region"] if scene.labels else [])]
            if {"normals", "color"} & set(self._layers):
                names.append(NORMAL.name)
            copy = Readback(self._context)
            copy.request(rendered.pool, {n: rendered.layers[n] for n in names}, scene.crop)
            return copy.arrays()

    def _deliver(self, item: _InFlight | Skipped) -> Frame | Skipped:
        """Wait for a frame's layers, run its array stages, and assemble the Frame."""
        if isinstance(item, Skipped):
            return item
        make_current(self._context)
        layers = item.readback.arrays()
        if not layers["clean"].any():
            at = ", ".join(f"{n} {item.scene.pose[n]:.0f}" for n in ("distance_mm", "x_mm", "y_mm"))
            why = f"the mesh covers no pixel at {at}: it is outside the image, too small, "
            return self._skipped(item.task, MeshError(f"{why}or its triangles are inside out"))
        run_array_stages(self.sensor.stages, layers, item.frame, item.values)
        if item.rolled:
            settle_reasons(layers)
        task, scene, rig = item.task, item.scene, self.sensor.rig
        window, crop, image = item.frame.window, rig.on_canvas(scene.crop), self._canvas.intrinsics
        head_to_camera, landmarks_m = scene.head_to_camera_m, scene.landmarks_m
        if (colour := rig.registered) is not None:
            layers = register(layers, window, image, colour, item.true, scene.crop)
            window, crop, image = scene.crop, scene.crop, rig.delivered
            head_to_camera = product(colour.from_depth(), head_to_camera)
            if landmarks_m is not None:
                landmarks_m = to_camera(landmarks_m, colour.from_depth())
        shown: dict[str, NDArray[Any]] = dict(layers)
        if "color" in self._layers:
            shown["color"] = color_image(layers, self._scenes.region_numbers, task.seeds)
        for name, layer in (("region", "regions"), (NORMAL.name, "normals")):
            if layer not in self._layers and name not in self._extra:  # for colour only
                shown.pop(name, None)
        made = assemble_frame(
            shown,
            window,
            crop,
            image,
            self.settings.output,
            self._extra,
            key=task.key,
            source=self._sources[task.source].name,
            seed=task.seeds.frame,
            pose=scene.pose,
            expression=scene.face.expression,
            parameters={**item.sampled, **scene.sampled},
            notes=scene.face.notes,
            region_numbers=self._scenes.region_numbers,
            head_to_camera=head_to_camera,
        )
        if landmarks_m is None:
            return made
        return replace(made, landmarks=seen_landmarks(landmarks_m, made))
