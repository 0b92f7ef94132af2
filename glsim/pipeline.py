"""Turn settings into frames: the file to read first.

simulate(settings)       opens the sources and the context; per task of the plan, a Simulator runs
    source.load          -> a face (mesh in canonical axes, mm), in batches
    vary                 -> the face with another shape and albedo, if the settings vary it
    Dresser.dress        -> the face with hair, glasses and cloth, if the settings dress it
    pose, draw_values    -> pose and stage parameters, drawn from the task's seeds
    move_pose, bend_neck -> motion of generated heads; shoulders stay upright below a turned head
    crop_window          -> the delivered part of the image
    Renderer.render      -> clean, normal, albedo, lit (region on request): GPU targets
    ShaderChain.run      -> depth (noisy), reason, infrared: GPU targets, readback queued
    Readback.arrays      -> the same as float32 arrays
    run_array_stages     -> depth and reason after the Python stages
    assemble_frame       -> Frame, in the order of the tasks (or Skipped for a bad face)
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.appearance.dress import Dresser, worn_regions
from glsim.errors import ConfigError, GlsimError, MeshError
from glsim.faces import open_source
from glsim.faces.base import BadFace, Face, FaceSource, Part
from glsim.faces.head_motion import head_motion, move_pose
from glsim.faces.landmarks import landmark_vertices, to_camera
from glsim.faces.neck import bend_neck
from glsim.faces.regions import RegionLabels
from glsim.faces.variation import draw_variation, vary
from glsim.frame import LAYERS, Frame, Skipped
from glsim.frame_assembly import assemble_frame, seen_landmarks
from glsim.geometry.camera import Intrinsics
from glsim.geometry.pose import pose_matrix
from glsim.geometry.rect import Rect
from glsim.gl.context import borrowed_context, is_software, make_current
from glsim.gl.targets import Readback
from glsim.noise.chain import LinkedStages, ShaderChain, array_reach_px, run_array_stages
from glsim.noise.frame_context import FrameContext
from glsim.noise.registry import find_stage, shader_stage
from glsim.noise.stage import ENABLED, draw_values
from glsim.plan.tasks import Task, make_tasks
from glsim.render.regions import REGION
from glsim.render.renderer import NORMAL, Renderer
from glsim.scene.body import body_of
from glsim.scene.other_people import OtherPeople
from glsim.scene.scenery import Prop, build_scenery, check_behind, scene_regions
from glsim.sensors.sensor import Sensor, StageChange, sensor_of
from glsim.settings.schema import GENERATORS, Settings, with_assignments
from glsim.settings.seeds import stable_seed

#: Faces per batch: a matrix product of this many rows keeps a core busy, and the vertices of a
#: batch take tens of megabytes.
_FACE_BATCH = 32

#: Frames in flight between drawing and readback. A GPU draws asynchronously and needs a few; the
#: software rasteriser draws at once, where more frames only add delay.
_RING_ON_GPU = 4


@dataclass(eq=False)
class _InFlight:
    """A frame between drawing and readback."""

    readback: Readback
    task: Task
    face: Face
    crop: Rect
    frame: FrameContext
    values: dict[str, dict[str, float]]
    pose: dict[str, float]
    drawn: dict[str, float]
    head_to_camera: NDArray[np.float64]
    landmarks_m: NDArray[np.float64] | None


def simulate(
    settings: Settings,
    tasks: Iterable[Task] | None = None,
    *,
    sources: Sequence[FaceSource] | None = None,
    backend: str | None = None,
    context: moderngl.Context | None = None,
    layers: Collection[str] = LAYERS,
    extra_layers: Sequence[str] = (),
) -> Iterator[Frame | Skipped]:
    """Make the frames of ``tasks`` (default: the whole plan), in order, one result per task.

    sources: the open face sources, any FaceSource (default: those of ``settings.source``).
    backend: "egl" or "osmesa". context: draws the frames; by default one of this thread is used.
    layers: the images that are needed. Without "infrared" that image is 0 unless a stage reads it;
    "regions", the parts of the face, and "expected" are drawn on request only.
    extra_layers: layers of the stages to copy to ``Frame.extra``.
    A face that cannot be rendered becomes a Skipped. Raises ConfigError, ShaderError, DeviceError,
    and MeshError for a bad face if ``settings.strict``.
    """
    opened = list(sources) if sources is not None else open_sources(settings)
    planned = make_tasks(settings, opened) if tasks is None else tasks
    with nullcontext(context) if context is not None else borrowed_context(backend) as drawn_in:
        yield from Simulator(settings, opened, drawn_in, extra_layers, layers).frames(planned)


def open_sources(settings: Settings) -> list[FaceSource]:
    """Open the face sources that the settings name. Raises ConfigError."""
    return [
        open_source(s, stable_seed("source", settings.seed, number))
        for number, s in enumerate(settings.source)
    ]


class Simulator:
    """Makes frames of one sensor on one GL context.

    ``with_values``, ``with_stage`` and ``with_layers`` return another simulator of the same
    sources and context, which shares what has not changed: no program is linked anew. The first
    one stays as it is, so that it serves on if a change is refused.
    """

    def __init__(
        self,
        settings: Settings,
        sources: Sequence[FaceSource],
        context: moderngl.Context,
        extra_layers: Sequence[str] = (),
        layers: Collection[str] = LAYERS,
        changes: Sequence[StageChange] = (),
        *,
        like: Simulator | None = None,
    ) -> None:
        """Compile the shaders. Arguments as in ``simulate``. Raises ConfigError or ShaderError.

        changes: stages with other code than the sensor's file says. like: a simulator of the same
        sources and context, whose programs are used.
        """
        self._settings, self._sources, self._extra = settings, sources, tuple(extra_layers)
        self._context, self._layers, self._changes = context, layers, tuple(changes)
        self.sensor: Sensor = sensor_of(settings, changes)
        make_current(context)
        same_rig = like is not None and like.sensor.rig == self.sensor.rig
        self._renderer: Renderer = (
            like._renderer if like and same_rig else Renderer(context, self.sensor.rig)
        )
        self._linked: LinkedStages = like._linked if like else LinkedStages(context)
        read_back = (
            *self._extra,
            *((REGION.name,) if "regions" in layers else ()),
            *((NORMAL.name,) if "normals" in layers and NORMAL.name not in self._extra else ()),
        )
        own = self.sensor.pattern_map
        self._chain = ShaderChain(
            context,
            self.sensor.stages,
            read_back,
            infrared="infrared" in layers,
            expected="expected" in layers,
            pattern_mm=None if own is None else own.error_mm,
            linked=self._linked,
        )
        further = [*scene_regions(settings.scene), *worn_regions(settings.appearance, sources)]
        self._labels = RegionLabels(sources, further) if "regions" in layers else None
        same_wear = like is not None and like._settings.appearance == settings.appearance
        self._dressers: list[Dresser] = (
            like._dressers
            if like is not None and same_wear
            else [Dresser(source, settings.appearance) for source in sources]
        )
        self._others = OtherPeople(settings, sources, self._dressers, self.sensor.rig)
        ring = 1 if is_software(context) else _RING_ON_GPU
        self._readbacks = [Readback(context) for _ in range(ring)]
        crop = settings.output.crop
        image = self.sensor.rig.intrinsics
        if crop is not None and crop > min(image.width, image.height):
            raise ConfigError(
                f"output.crop {crop} is larger than the sensor's {image.width}x{image.height}"
            )

    @property
    def settings(self) -> Settings:
        """The settings that determine the frames, with the values of ``with_values``."""
        return self._settings

    def with_values(self, values: Mapping[str, Any]) -> Simulator:
        """Return a simulator with other values, by the names of ``--set``.

        values: {"tof_floor.sigma_mm": 2, "pose.yaw_deg": {"uniform": [-30, 30]}, "seed": 3}.
        Raises ConfigError for an unknown name or a value out of range, and for a change of the
        source, which needs another Simulator.
        """
        return self._like(settings=with_assignments(self._settings, values))

    def with_stage(
        self, name: str, code: str | Path, before: str | None = None, file: Path | None = None
    ) -> Simulator:
        """Return a simulator whose stage ``name`` runs other GLSL; that program alone is linked.

        code: the text, or the path of a file. file: of a text, for messages and includes; default:
        the file of the stage, or NAME.glsl. before: inserts a new stage before another; a name that
        the chain does not have is otherwise put after the last shader stage.
        Raises ShaderError with file and line; ConfigError if the stage does not fit the chain.
        """
        known = {stage.name: stage for stage in self.sensor.stages}
        if isinstance(code, Path):
            spec = find_stage(str(code))
        else:
            of_stage = Path(known[name].spec.file) if name in known else Path(f"{name}.glsl")
            spec = shader_stage(code, file or of_stage)
        previous = next((c.before for c in self._changes if c.name == name), None)
        kept = [change for change in self._changes if change.name != name]
        change = StageChange(name, spec, before or previous)
        left_out = set(self._settings.stage.get(name, {})) - {ENABLED, *spec.parameters}
        settings = self._settings
        if left_out:
            own = {k: v for k, v in settings.stage[name].items() if k not in left_out}
            stages = {**settings.stage, name: own}
            settings = settings.model_copy(update={"stage": stages})
        return self._like(settings=settings, changes=[*kept, change])

    def with_layers(self, layers: Collection[str], extra_layers: Sequence[str] = ()) -> Simulator:
        """Return a simulator that delivers other layers; arguments as in ``simulate``."""
        return self._like(layers=layers, extra_layers=extra_layers)

    def _like(
        self,
        settings: Settings | None = None,
        changes: Sequence[StageChange] | None = None,
        layers: Collection[str] | None = None,
        extra_layers: Sequence[str] | None = None,
    ) -> Simulator:
        wanted = settings or self._settings
        if wanted.source != self._settings.source:
            raise ConfigError("source: other faces need another Simulator")
        return Simulator(
            wanted,
            self._sources,
            self._context,
            self._extra if extra_layers is None else extra_layers,
            self._layers if layers is None else layers,
            self._changes if changes is None else changes,
            like=self,
        )

    def frames(self, tasks: Iterable[Task]) -> Iterator[Frame | Skipped]:
        """Yield one result per task, in order."""
        in_flight: deque[_InFlight | Skipped] = deque()
        ring = len(self._readbacks)
        for number, (task, face) in enumerate(self._faces(tasks)):
            if len(in_flight) == ring:
                yield self._deliver(in_flight.popleft())
            in_flight.append(self._start(task, face, self._readbacks[number % ring]))
        while in_flight:
            yield self._deliver(in_flight.popleft())

    def _faces(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Face | BadFace]]:
        """Load faces in batches of tasks that share a source.

        A thread reads the next batch while one is drawn, so that drawing does not wait for disks.
        """
        with ThreadPoolExecutor(1, "faces") as reader:
            ahead: deque[Future[list[tuple[Task, Face | BadFace]]]] = deque()
            for batch in _batches(tasks):
                ahead.append(reader.submit(self._load, batch))
                if len(ahead) == 2:
                    yield from ahead.popleft().result()
            while ahead:
                yield from ahead.popleft().result()

    def _load(self, batch: Sequence[Task]) -> list[tuple[Task, Face | BadFace]]:
        """Load the faces of one source. A file that its source cannot survive is a bad face."""
        self._others.load([self._held(task) for task in batch])
        source = self._sources[batch[0].source]
        loaded: list[tuple[Task, Face | BadFace]] = []
        while len(loaded) < len(batch):
            rest = batch[len(loaded) :]
            faces = iter(source.load([task.key for task in rest]))
            for task in rest:
                try:
                    face = next(faces, None)
                    if isinstance(face, Face):
                        face = self._change(task, face)
                except GlsimError:
                    raise
                except Exception as error:
                    if not task.key.path:
                        raise  # no file is to blame
                    loaded.append((task, BadFace(task.key, _unusable(task, error))))
                    break  # the iterator has ended: the others get a new one
                if face is None:
                    raise GlsimError(f"source {source.name} gave no face for {task.stem}")
                loaded.append((task, face))
        return loaded

    def _change(self, task: Task, face: Face) -> Face:
        """Vary a face, then dress it: what is worn follows the varied mesh."""
        seeds = self._held(task).seeds
        varied = vary(face, self._settings.variation, seeds)
        return self._dressers[task.source].dress(varied, seeds)

    def _held(self, task: Task) -> Task:
        """Return the task with the seeds of its settings; those of its noise are its own."""
        if self._settings.redraw is None:
            return task
        return replace(task, seeds=task.seeds.held_in_sequence())

    def _start(self, task: Task, face: Face | BadFace, readback: Readback) -> _InFlight | Skipped:
        """Queue the drawing of one frame, or return the record of a bad face."""
        try:
            if isinstance(face, BadFace):
                raise face.error
            return self._draw(task, face, readback)
        except MeshError as error:
            return self._skipped(task, error)
        except MemoryError as error:
            return self._skipped(task, _unusable(task, error))

    def _skipped(self, task: Task, error: MeshError) -> Skipped:
        """Return the record of a bad face. Raises ``error`` if the settings are strict."""
        if self._settings.strict:
            raise error
        return Skipped(task.key, self._sources[task.source].name, str(error))

    def _draw(self, task: Task, face: Face, readback: Readback) -> _InFlight:
        settings, rig = self._settings, self.sensor.rig
        held = self._held(task)
        make_current(self._context)  # the caller may have used another since the last frame
        pose = {
            name: getattr(settings.pose, name).draw(held.seeds, f"pose.{name}")
            for name in type(settings.pose).model_fields
        }
        still, motion = pose, pose.pop("motion")
        if self._sources[task.source].name in GENERATORS:  # recorded faces move by themselves
            offsets = head_motion(task.seeds.sequence, task.key.time_s)
            offsets = {name: motion * offset for name, offset in offsets.items()}
            pose = move_pose(pose, offsets, face.neck)
        drawn, values = draw_values(self.sensor.stages, held.seeds)
        drawn |= draw_variation(settings.variation, held.seeds)
        drawn |= self._dressers[task.source].drawn(face, held.seeds)
        body = body_of(face) if settings.scene.room != "none" else None
        scenery = build_scenery(settings.scene, settings.pose, held.seeds, rig, body)
        drawn |= scenery.drawn
        person = [
            bend_neck(mesh, face.neck, pose, still)
            for mesh in (face.mesh, *(part.mesh for part in face.parts))
        ]
        view = scenery.stands(pose_matrix(pose))
        check_behind(scenery, person, view)
        others = self._others.props(held, scenery) if body is not None else []
        further = [*scenery.props, *others]
        meshes = [(mesh, view) for mesh in person] + [(prop.mesh, prop.view) for prop in further]
        crop = crop_window(rig.intrinsics, still, settings.output.crop)
        labels: list[NDArray[np.float32] | None] = []
        if self._labels is not None:
            named: list[Part | Prop] = [*face.parts, *further]
            labels = [
                self._labels.of(task.source, len(face.mesh.vertices_mm)),
                *(self._labels.uniform(x.region, len(x.mesh.vertices_mm)) for x in named),
            ]
        reach_px = array_reach_px(self.sensor.stages, values)
        with self._renderer.render(meshes, crop, labels, reach_px) as rendered:
            frame = FrameContext.for_frame(
                rig=rig,
                window=rendered.window,
                seed=task.seeds.frame,
                sequence_seed=task.seeds.sequence,
                device_seed=stable_seed("device", settings.seed, task.device),
                time_s=task.key.time_s,
                nearest_m=rendered.nearest_m,
            )
            self._chain.run(rendered, frame, values, readback)
        head_to_camera, landmarks_m = view.astype(np.float64), None
        if settings.output.landmarks:
            chosen = landmark_vertices(self._sources[task.source])
            landmarks_m = to_camera(person[0].vertices_mm[chosen], head_to_camera)
        head_to_camera[:3, :3] *= 1000.0  # the view takes millimetres, this matrix metres
        return _InFlight(
            readback, task, face, crop, frame, values, pose, drawn, head_to_camera, landmarks_m
        )

    def _deliver(self, item: _InFlight | Skipped) -> Frame | Skipped:
        """Wait for one frame's layers, run the array stages, and assemble the Frame."""
        if isinstance(item, Skipped):
            return item
        make_current(self._context)
        layers = item.readback.arrays()
        if not layers["clean"].any():
            return self._skipped(
                item.task,
                MeshError(
                    "the mesh covers no pixel: its triangles are wound inside out, or too small"
                ),
            )
        run_array_stages(self.sensor.stages, layers, item.frame, item.values)
        task, face = item.task, item.face
        made = assemble_frame(
            layers,
            item.frame.window,
            item.crop,
            self.sensor.rig.intrinsics,
            self._settings.output,
            self._extra,
            key=task.key,
            source=self._sources[task.source].name,
            seed=task.seeds.frame,
            pose=item.pose,
            expression=face.expression,
            parameters=item.drawn,
            notes=face.notes,
            region_numbers={} if self._labels is None else self._labels.numbers,
            head_to_camera=item.head_to_camera,
        )
        if item.landmarks_m is None:
            return made
        return replace(made, landmarks=seen_landmarks(item.landmarks_m, made))


def _unusable(task: Task, error: Exception) -> MeshError:
    what = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}".removesuffix(": ")
    return MeshError(f"{task.key.path or task.stem}: cannot be used ({what})")


def _batches(tasks: Iterable[Task]) -> Iterator[list[Task]]:
    """Split tasks, in their order, into batches of one source each."""
    for _, run in itertools.groupby(tasks, key=lambda task: task.source):
        while batch := list(itertools.islice(run, _FACE_BATCH)):
            yield batch


def crop_window(image: Intrinsics, pose: Mapping[str, float], side: int | None) -> Rect:
    """Return the delivered square, centred on the face and shifted into the image.

    side: pixels; None delivers the whole image.
    """
    if side is None:
        return Rect(0, 0, image.width, image.height)
    # A face at or behind the camera has no place in the image; the renderer reports it.
    depth_mm = max(pose["distance_mm"], 1.0)
    centre = image.project(np.array([[pose["x_mm"], pose["y_mm"], depth_mm]]))[0]
    left = int(np.clip(round(centre[0] - side / 2), 0, image.width - side))
    top = int(np.clip(round(centre[1] - side / 2), 0, image.height - side))
    return Rect(left, top, side, side)
