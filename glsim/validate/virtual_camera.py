"""A virtual camera that captures frames of a scene through the simulator."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.faces.base import Face, FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.frame import Frame
from glsim.geometry.camera import SensorRig
from glsim.geometry.mesh import Mesh
from glsim.measures.stacks import Array, with_nan
from glsim.pipeline import Simulator
from glsim.plan.tasks import make_tasks
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.schema import Settings, load_settings

#: Signs that turn camera axes into canonical axes: a half turn about x.
_TO_CANONICAL = np.array([1, -1, -1], np.float32)

#: Simulators to keep; the programs and render targets of each take about 80 MB.
_KEPT_SIMULATORS = 4

#: Changes to a sensor's stages: stage -> parameter -> value.
Changes = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class Capture:
    """Frames of one static scene.

    Attributes:
        frames_mm: (T, H, W) delivered depth, whole mm, NaN = no depth.
        fine_mm: (T, H, W) the same before rounding to uint16; stages may have rounded it.
        clean_mm: (H, W) true depth, NaN = no surface.
        infrared: (T, H, W) counts.
        reason: (T, H, W) reason codes.
        rays: (H, W, 2) x/z and y/z.
        encoded: (T, H, W) uint16, the values of the depth files.
        extra: name -> (T, H, W, components) of additional layers; none of a disabled stage.

    """

    frames_mm: Array
    fine_mm: Array
    clean_mm: Array
    infrared: NDArray[np.float32]
    reason: NDArray[np.uint8]
    rays: NDArray[np.float32]
    encoded: NDArray[np.uint16]
    extra: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)

    @property
    def residual_mm(self) -> Array:
        """(T, H, W) delivered minus clean depth, mm."""
        return self.frames_mm - self.clean_mm

    def centre(self, width: int = 64, height: int | None = None) -> Capture:
        """Crop all images to their centre, width x height px (default: a square)."""
        h, w = self.clean_mm.shape
        height = width if height is None else height
        rows = slice((h - height) // 2, (h - height) // 2 + height)
        columns = slice((w - width) // 2, (w - width) // 2 + width)
        return Capture(
            self.frames_mm[:, rows, columns],
            self.fine_mm[:, rows, columns],
            self.clean_mm[rows, columns],
            self.infrared[:, rows, columns],
            self.reason[:, rows, columns],
            self.rays[rows, columns],
            self.encoded[:, rows, columns],
            {name: layer[:, rows, columns] for name, layer in self.extra.items()},
        )


class VirtualCamera:
    """Captures frames of meshes with one sensor in one GL context."""

    def __init__(
        self,
        sensor: str,
        context: moderngl.Context,
        seed: int = 0,
        frames: int = 64,
        rig: Mapping[str, Any] | None = None,
        assignments: Sequence[str] = (),
    ) -> None:
        """Load the sensor. Raises ConfigError.

        Args:
            frames: default number of a capture.
            rig: keys of the sensor's [rig] to override.
            assignments: settings as of ``--set``, "fixed_pattern.enabled=0".
        """
        self.name, self.seed, self.frames = sensor, seed, frames
        self._assignments = tuple(assignments)
        self._own_rig = dict(rig or {})
        self.sensor: Sensor = load_sensor(sensor, rig_overrides=self._own_rig)
        self._context = context
        self._simulators: OrderedDict[str, tuple[Simulator, _Scene]] = OrderedDict()

    @property
    def rig(self) -> SensorRig:
        """The sensor's geometry."""
        return self.sensor.rig

    def capture(
        self,
        mesh: Mesh,
        frames: int | None = None,
        crop: int | None = 72,
        *,
        at_mm: tuple[float, float, float] = (0.0, 0.0, 1000.0),
        changes: Changes | None = None,
        scene: str = "scene",
        seed: int | None = None,
        extra: Sequence[str] = (),
    ) -> Capture:
        """Capture frames of a mesh.

        Args:
            mesh: in the camera frame, mm.
            frames: their number; default: that of the camera.
            crop: side of the square around the image of ``at_mm``, px; None: the whole image.
            at_mm: centre of the crop, in the camera frame.
            changes: parameters of the sensor's stages.
            scene: name that, with the seed, decides the noise.
            seed: of the device; default: the camera's.
            extra: layers of the stages to return as well.

        """
        x, y, z = at_mm
        if x == 0 and y == 0:
            z = 1000.0  # one window for all distances: they share a simulator
        overrides = {
            "sensor": self.name,
            "seed": self.seed if seed is None else seed,
            "strict": True,
            "pose": {"x_mm": x, "y_mm": y, "distance_mm": z},
            "stage": dict(changes or {}),
            "output": {} if crop is None else {"crop": crop},
            "rig": self._own_rig,
        }
        settings = load_settings(
            None,
            self._assignments,
            overrides,
            {"subjects": 1, "frames_per_subject": frames or self.frames},
        )
        simulator, source = self._simulator(f"{overrides} {tuple(extra)}", settings, extra)
        canonical = (mesh.vertices_mm - np.array((x, y, z), np.float32)) * _TO_CANONICAL
        source.show(Mesh(canonical, mesh.faces, mesh.albedo), scene)
        tasks = make_tasks(settings, [source])
        return _stack_frames([f for f in simulator.frames(tasks) if isinstance(f, Frame)])

    def _simulator(
        self, key: str, settings: Settings, extra: Sequence[str]
    ) -> tuple[Simulator, _Scene]:
        """Return the simulator of some settings and its scene; the last few are kept."""
        if key not in self._simulators:
            source = _Scene()
            self._simulators[key] = (Simulator(settings, [source], self._context, extra), source)
            if len(self._simulators) > _KEPT_SIMULATORS:
                self._simulators.popitem(last=False)
        self._simulators.move_to_end(key)
        return self._simulators[key]


class _Scene:
    """A face source of one mesh, which can be replaced."""

    name = "mesh"

    def __init__(self) -> None:
        self._shown: OneMesh | None = None

    def show(self, mesh: Mesh, scene: str) -> None:
        """Replace the mesh, canonical frame, mm; the name of the scene decides the noise."""
        self._shown = OneMesh(mesh, scene)

    @property
    def _source(self) -> OneMesh:
        assert self._shown is not None, "no mesh: call show() first"
        return self._shown

    def subjects(self, count: int | None) -> list[str]:
        return self._source.subjects(count)

    def frames(self, subject: str, count: int | None) -> Sequence[FaceKey]:
        return self._source.frames(subject, count)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        return self._source.load(keys)


def _stack_frames(frames: list[Frame]) -> Capture:
    """Stack frames of one window into arrays of the delivered image."""
    first = frames[0]
    shape = (first.intrinsics.height, first.intrinsics.width)

    def pasted(name: str) -> NDArray[np.float32]:
        out = np.zeros((len(frames), *shape), np.float32)
        for image, frame in zip(out, frames, strict=True):
            image[frame.window.slices] = getattr(frame, name)
        return out

    encoded = np.stack([frame.noisy for frame in frames])
    clean = np.zeros(shape)
    clean[first.window.slices] = first.clean_m * 1000.0
    return Capture(
        with_nan(encoded),
        with_nan(pasted("noisy_m").astype(np.float64) * 1000.0),
        with_nan(clean),
        pasted("infrared_counts"),
        np.stack([frame.reason for frame in frames]),
        first.intrinsics.rays(),
        encoded,
        {name: _paste_layer(frames, name, shape) for name in first.extra},
    )


def _paste_layer(frames: list[Frame], name: str, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Paste an extra layer of frames of one window into (T, *shape, components)."""
    layers = np.stack([frame.extra[name] for frame in frames])
    out = np.zeros((len(frames), *shape, *layers.shape[3:]), np.float32)
    out[:, *frames[0].window.slices] = layers
    return out
