"""A virtual camera that captures frames of a mesh through the simulator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from moderngl import Context

from glsim.core.depth_frame import Frames
from glsim.core.mesh import Mesh
from glsim.core.units import MM_PER_M
from glsim.faces.face_source import Face, FaceKey, WornPart
from glsim.faces.one_mesh import OneMesh
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.schema import load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import Simulator
from glsim.simulation.plan.tasks import make_tasks

#: Signs that turn camera axes into canonical axes: a half turn about x.
_TO_CANONICAL = np.array([1, -1, -1], np.float32)

#: Number of kept simulators; the programs and render targets of one take about 80 MB.
_KEPT_SIMULATORS = 4

#: Changes to a sensor's stages: stage -> parameter -> value.
Changes = Mapping[str, Mapping[str, float]]


class VirtualCamera:
    """A virtual camera that captures frames of meshes with one sensor in one GL context."""

    def __init__(
        self,
        sensor: str,
        context: Context,
        seed: int = 0,
        frames: int = 64,
        rig: Mapping[str, Any] | None = None,
        assignments: Sequence[str] = (),
    ) -> None:
        """Load the sensor; ``rig`` replaces keys of its [rig]."""
        self.name, self.seed, self.frames = sensor, seed, frames
        self._assignments = tuple(assignments)
        self._own_rig = dict(rig or {})
        self.sensor: Sensor = load_sensor(sensor, rig_overrides=self._own_rig)
        self.rig = self.sensor.rig
        self._context = context
        self._simulators: dict[str, tuple[Simulator | None, _Scene]] = {}

    def capture(
        self,
        mesh: Mesh,
        frames: int | None = None,
        crop: int | None = 72,
        *,
        at_mm: tuple[float, float, float] = (0.0, 0.0, MM_PER_M),
        changes: Changes | None = None,
        scene: str = "scene",
        seed: int | None = None,
        extra: Sequence[str] = (),
        worn: Sequence[Mesh] = (),
    ) -> Frames:
        """Capture frames of a mesh, with clean depth, infrared and unrounded depth.

        Args:
            mesh: the mesh in the camera frame, mm.
            crop: side of the square around the image of ``at_mm``, px; None: the whole image.
            at_mm: centre of the crop, in the camera frame.
            changes: parameters of the sensor's stages.
            scene: name that, with the seed, decides the noise.
            extra: layers of the stages to return as well.
            worn: further meshes, such as hair, in the camera frame, mm.
        """
        x, y, z = at_mm
        if x == 0 and y == 0:
            z = MM_PER_M  # one window for all distances, so that they share a simulator
        overrides = {
            "sensor": self.name,
            "seed": self.seed if seed is None else seed,
            "strict": True,
            "pose": {"x_mm": x, "y_mm": y, "distance_mm": z},
            "stage": dict(changes or {}),
            "output": {} if crop is None else {"crop": crop},
            "rig": self._own_rig,
        }
        source_tables = {"subjects": 1, "frames_per_subject": frames or self.frames}
        settings = load_settings(None, self._assignments, overrides, source_tables)
        centre = np.array((x, y, z), np.float32)
        canonical, *parts = (
            replace(m, vertices_mm=(m.vertices_mm - centre) * _TO_CANONICAL) for m in (mesh, *worn)
        )
        source = _Scene(canonical, scene)
        source.parts = tuple(WornPart(part, "worn") for part in parts)
        key = f"{overrides} {tuple(extra)}"
        simulator, kept = self._simulators.pop(key, (None, source))
        if simulator is None:
            simulator = Simulator(settings, [source], self._context, extra)
        kept.show(source)
        self._simulators[key] = simulator, kept
        if len(self._simulators) > _KEPT_SIMULATORS:
            del self._simulators[next(iter(self._simulators))]  # the least recently used
        made = [f for f in simulator.frames(make_tasks(settings, [kept])) if isinstance(f, Frame)]
        return Frames.of([f.measured(rounded=False) for f in made], scene)


class _Scene(OneMesh):
    """A source with replaceable meshes, whose scene name decides the noise."""

    parts: tuple[WornPart, ...] = ()

    def show(self, other: _Scene) -> None:
        self._mesh, self._subject, self.parts = other._mesh, other._subject, other.parts

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        return (replace(face, parts=self.parts) for face in super().load(keys))
