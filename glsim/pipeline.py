"""From settings to frames: the file to read first.

simulate(settings)   for each task of the plan:
    source.load      -> a face (mesh in the canonical frame)
    vary             -> a warped, patchy one, where the settings ask for it
    pose, parameters -> drawn from the frame's seed
    Renderer         -> clean, normal, albedo, lit
    ShaderChain      -> depth (noisy), reason, infrared
    Readback         -> arrays, array stages
    Frame            -> 16-bit images, in the order of the plan
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.config import Settings
from glsim.distribution import DrawKeys
from glsim.errors import ConfigError, MeshError
from glsim.faces import open_source
from glsim.faces.base import BadFace, Face, FaceSource
from glsim.finish import finish
from glsim.frame import LAYERS, Frame, Rect, Skipped
from glsim.gl.context import is_software, make_current, open_context
from glsim.gl.targets import Readback
from glsim.mesh import Mesh
from glsim.noise.chain import ShaderChain, array_reach_px, run_array_stages
from glsim.noise.stage import Stage
from glsim.noise.view import FrameContext, Optics
from glsim.plan import Task, make_tasks, stable_seed
from glsim.pose import pose_matrix
from glsim.regionpass import REGION
from glsim.regions import RegionLabels
from glsim.render import Renderer
from glsim.sensor import Sensor, sensor_of
from glsim.variation import draw_variation, vary

#: Faces that are evaluated together: a matrix product of this many rows keeps a core busy while
#: the vertices of a batch stay in tens of megabytes.
_FACE_BATCH = 32

#: Frames in flight between drawing and reading. A GPU works behind the CPU's back and needs a few;
#: the software rasteriser draws when told and only delays the frame.
_RING_ON_GPU = 4

#: A wall is a square of this half side, which fills any view up to 12 m.
_WALL_MM = 20_000.0

_WALL_FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


@dataclass(eq=False)
class _InFlight:
    readback: Readback
    task: Task
    face: Face
    crop: Rect
    context: FrameContext
    values: dict[str, dict[str, float]]
    pose: dict[str, float]
    drawn: dict[str, float]


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
    """Make the frames of ``tasks`` (default: the whole plan), in order, one result each.

    sources: what ``settings.source`` describes, if it is open already; any FaceSource will do.
    backend: "egl" or "osmesa". context: one to draw in; by default one is opened and closed.
    layers: that will be looked at. Without "infrared" that image stays 0 unless a stage needs it;
    "regions", the parts of the face, are drawn only with it.
    extra_layers: further layers of the stages that frames shall carry (``Frame.extra``).
    A face that cannot be rendered becomes a Skipped. Raises ConfigError, ShaderError, DeviceError,
    and MeshError for a bad face if ``settings.strict``.
    """
    opened = list(sources) if sources is not None else open_sources(settings)
    planned = make_tasks(settings, opened) if tasks is None else tasks
    own_context = open_context(backend) if context is None else None
    drawn_in = context or own_context
    assert drawn_in is not None
    try:
        yield from Simulator(settings, opened, drawn_in, extra_layers, layers).frames(planned)
    finally:
        if own_context is not None:
            own_context.release()


def open_sources(settings: Settings) -> list[FaceSource]:
    """The face sources that the settings name. Raises ConfigError."""
    return [
        open_source(s, stable_seed("source", settings.seed, number))
        for number, s in enumerate(settings.source)
    ]


class Simulator:
    """A sensor on one GL context, making frames."""

    def __init__(
        self,
        settings: Settings,
        sources: Sequence[FaceSource],
        context: moderngl.Context,
        extra_layers: Sequence[str] = (),
        layers: Collection[str] = LAYERS,
    ) -> None:
        """extra_layers: further layers of the stages that frames shall carry (``Frame.extra``)."""
        self._settings, self._sources, self._extra = settings, sources, tuple(extra_layers)
        self._context = context
        self.sensor: Sensor = sensor_of(settings)
        make_current(context)
        self._renderer = Renderer(context, self.sensor.rig)
        brought = (*self._extra, REGION.name) if "regions" in layers else self._extra
        self._chain = ShaderChain(
            context, self.sensor.stages, brought, infrared="infrared" in layers
        )
        self._labels = RegionLabels(sources) if "regions" in layers else None
        ring = 1 if is_software(context) else _RING_ON_GPU
        self._readbacks = [Readback(context) for _ in range(ring)]
        crop = settings.output.crop
        image = self.sensor.rig.intrinsics
        if crop is not None and crop > min(image.width, image.height):
            raise ConfigError(
                f"output.crop {crop} is larger than the sensor's {image.width}x{image.height}"
            )

    def frames(self, tasks: Iterable[Task]) -> Iterator[Frame | Skipped]:
        """One result a task, in order."""
        in_flight: deque[_InFlight | Skipped] = deque()
        ring = len(self._readbacks)
        for number, (task, face) in enumerate(self._faces(tasks)):
            if len(in_flight) == ring:
                yield self._deliver(in_flight.popleft())
            in_flight.append(self._start(task, face, self._readbacks[number % ring]))
        while in_flight:
            yield self._deliver(in_flight.popleft())

    def _faces(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Face | BadFace]]:
        """Geometry in batches of tasks that share a source.

        While one batch is drawn, a thread reads the next, so that disks do not hold drawing up.
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
        loaded = self._sources[batch[0].source].load([task.key for task in batch])
        pairs = zip(batch, loaded, strict=True)
        variation = self._settings.variation
        return [
            (task, face if isinstance(face, BadFace) else vary(face, variation, task.seeds))
            for task, face in pairs
        ]

    def _start(self, task: Task, face: Face | BadFace, readback: Readback) -> _InFlight | Skipped:
        """Queue all drawing of one frame."""
        try:
            if isinstance(face, BadFace):
                raise face.error
            return self._draw(task, face, readback)
        except MeshError as error:
            return self._skipped(task, error)

    def _skipped(self, task: Task, error: MeshError) -> Skipped:
        """The record of a bad face. Raises it if the settings are strict."""
        if self._settings.strict:
            raise error
        return Skipped(task.key, self._sources[task.source].name, str(error))

    def _draw(self, task: Task, face: Face, readback: Readback) -> _InFlight:
        settings, rig = self._settings, self.sensor.rig
        make_current(self._context)  # whoever takes the frames may use another between two
        pose = {
            name: getattr(settings.pose, name).draw(task.seeds, f"pose.{name}")
            for name in type(settings.pose).model_fields
        }
        drawn, values = draw_values(self.sensor.stages, task.seeds)
        drawn |= draw_variation(settings.variation, task.seeds)
        meshes = [(face.mesh, pose_matrix(pose))]
        if settings.scene.wall_mm is not None:
            wall_mm = settings.scene.wall_mm.draw(task.seeds, "scene.wall_mm")
            drawn["scene.wall_mm"] = wall_mm
            meshes.append(
                (_wall(settings.scene.wall_albedo), pose_matrix({"distance_mm": wall_mm}))
            )
        crop = crop_window(rig.intrinsics, pose, settings.output.crop)
        labels: list[NDArray[np.float32] | None] = []
        if self._labels is not None:
            labels = [self._labels.of(task.source, len(face.mesh.vertices_mm))]
            labels += [None] * (len(meshes) - 1)  # the wall
        reach_px = array_reach_px(self.sensor.stages, values)
        layers, window = self._renderer.render(meshes, crop, labels, reach_px)
        context = FrameContext(
            window,
            rig.intrinsics.width,
            rig.intrinsics.height,
            task.seeds.frame,
            task.seeds.sequence,
            stable_seed("device", settings.seed, task.device),
            task.key.time_s,
            rig.intrinsics.fx * rig.baseline_m,
            Optics.of(rig, self._renderer.nearest_m),
        )
        self._chain.run(self._renderer, layers, context, values, readback)
        return _InFlight(readback, task, face, crop, context, values, pose, drawn)

    def _deliver(self, item: _InFlight | Skipped) -> Frame | Skipped:
        """Wait for one frame's layers and make them a Frame."""
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
        run_array_stages(self.sensor.stages, layers, item.context, item.values)
        task, face = item.task, item.face
        return finish(
            layers,
            item.context.window,
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
        )


def _batches(tasks: Iterable[Task]) -> Iterator[list[Task]]:
    """Tasks in their order, some at a time, each time of one source."""
    for _, run in itertools.groupby(tasks, key=lambda task: task.source):
        while batch := list(itertools.islice(run, _FACE_BATCH)):
            yield batch


def draw_values(
    stages: Sequence[Stage], seeds: DrawKeys
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """What was drawn from distributions, "stage.parameter" -> value, and all values by stage."""
    values = {stage.name: stage.draw(lambda s, name: s.draw(seeds, name)) for stage in stages}
    drawn = {
        f"{stage.name}.{name}": values[stage.name][name]
        for stage in stages
        for name, setting in stage.settings.items()
        if not setting.is_constant
    }
    return drawn, values


def crop_window(image: Intrinsics, pose: Mapping[str, float], side: int | None) -> Rect:
    """The square that is delivered, centred on the face and shifted to lie within the image."""
    if side is None:
        return Rect(0, 0, image.width, image.height)
    # A face at or behind the camera has no place in the image; the renderer says so.
    depth_mm = max(pose["distance_mm"], 1.0)
    centre = image.project(np.array([[pose["x_mm"], pose["y_mm"], depth_mm]]))[0]
    left = int(np.clip(round(centre[0] - side / 2), 0, image.width - side))
    top = int(np.clip(round(centre[1] - side / 2), 0, image.height - side))
    return Rect(left, top, side, side)


def _wall(albedo: float) -> Mesh:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
    return Mesh(corners * _WALL_MM, _WALL_FACES, np.full(4, albedo, dtype=np.float32))
