"""Helpers of the tests of time-of-flight sensors: scenes, and frames with all layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from moderngl import Context
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.faces.face_source import Face
from glsim.gl.targets import Readback
from glsim.noise.array_chain import run_array_stages
from glsim.noise.chain import ShaderChain
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import sample_values
from glsim.render.renderer import Rendered, Renderer
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import load_settings
from glsim.simulation.pipeline import open_sources
from glsim.simulation.plan.tasks import make_tasks

Image = NDArray[np.float32]
Placed = tuple[Mesh, NDArray[np.float32]]

FRAMED = ("clean", "depth", "reason", "infrared", "lit", "decoded", "phasor_a", "phasor_b")

#: Settings without the noise that differs between frames, or that moves depths off the scene.
QUIET = {
    "tof_taps": {"read_variance": 0.0, "shot_variance": 0.0, "companding": 0.0},
    "tof_light": {"harmonic_2": 0.0, "harmonic_5": 0.0, "indirect": 0.0},
    "tof_floor": {"enabled": 0.0},
    "fixed_pattern": {"enabled": 0.0},
    "millimetre_quantise": {"enabled": 0.0},
}

Changes = Mapping[str, Mapping[str, float]]


def merged(*changes: Changes) -> dict[str, dict[str, float]]:
    """Merge parameters by stage; later parameters replace earlier ones."""
    result: dict[str, dict[str, float]] = {}
    for change in changes:
        for stage, values in change.items():
            result.setdefault(stage, {}).update(values)
    return result


@dataclass(eq=False)
class Camera:
    """A sensor in the tests' OpenGL context."""

    context: Context
    sensor: Sensor
    renderer: Renderer
    chain: ShaderChain
    readback: Readback
    expected: bool = False

    @classmethod
    def open(
        cls, context: Context, name: str = "kinect-v2", expected: bool = False, **rig: object
    ) -> Camera:
        sensor = load_sensor(name, rig_overrides=rig)
        renderer = Renderer(context, sensor.rig)
        chain = ShaderChain(context, sensor.stages, expected=expected)
        return cls(context, sensor, renderer, chain, Readback(context), expected)

    def frame(self, rendered: Rendered, seed: int, device: int = 5) -> FrameContext:
        return FrameContext.for_frame(
            rig=self.sensor.rig,
            window=rendered.window,
            seed=seed,
            sequence_seed=seed,
            device_seed=device,
            nearest_m=rendered.nearest_m,
        )

    def values(self, changes: Changes) -> dict[str, dict[str, float]]:
        _, values = sample_values(self.sensor.stages, ScopeSeeds(0, 0, 0))
        for stage, given in changes.items():
            assert set(given) <= set(values[stage]), (stage, given)
            values[stage] |= given
        return values

    def shoot(
        self,
        meshes: Sequence[Placed],
        changes: Changes | None = None,
        seed: int = 1,
        device: int = 5,
        crop: Rect | None = None,
    ) -> dict[str, Image]:
        """Return the layers of a frame's window after the whole chain."""
        self.chain._wanted = (*FRAMED, "expected") if self.expected else FRAMED
        with self.renderer.render(meshes, crop) as rendered:
            frame, values = self.frame(rendered, seed, device), self.values(changes or {})
            self.chain.run(rendered, frame, values, self.readback)
        return {name: image.copy() for name, image in self.readback.arrays().items()}

    def clean(
        self, meshes: Sequence[Placed], seed: int = 1
    ) -> tuple[dict[str, Image], FrameContext]:
        """Return the layers before the first stage, and the context of their frame."""
        with self.renderer.render(meshes) as rendered:
            layers = {**rendered.layers, "rays": rendered.rays}
            self.readback.request(rendered.pool, layers, rendered.window)
            frame = self.frame(rendered, seed)
        return {name: image.copy() for name, image in self.readback.arrays().items()}, frame

    def twin(
        self, meshes: Sequence[Placed], changes: Changes | None = None, seed: int = 1
    ) -> dict[str, Image]:
        """Simulate the frame of ``shoot`` by the stages' NumPy twins; return its layers."""
        layers, frame = self.clean(meshes, seed)
        layers |= {"depth": layers["clean"], "reason": np.zeros_like(layers["clean"])}
        if self.expected:
            layers["expected"] = layers["clean"]
        run_array_stages(self.sensor.stages, layers, frame, self.values(changes or {}), twins=True)
        return layers


def quad(
    z_mm: float,
    x_mm: tuple[float, float] = (-9000, 9000),
    y_mm: tuple[float, float] = (-9000, 9000),
    albedo: float = 1.0,
    yaw_deg: float = 0.0,
) -> Placed:
    """Make a rectangle across the optical axis at a distance (y up, as in canonical axes)."""
    corners = [[x, y, 0.0] for x, y in zip((*x_mm, *x_mm[::-1]), np.repeat(y_mm, 2), strict=True)]
    mesh = Mesh(
        np.array(corners, np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(4, albedo, np.float32),
    )
    return mesh, pose_matrix({"distance_mm": z_mm, "yaw_deg": yaw_deg})


def face_scenes(count: int, seed: int = 0, wall_every: int = 3) -> list[list[Placed]]:
    """Yield procedural faces in random poses, each ``wall_every``-th with a wall."""
    settings = load_settings(source={"subjects": count, "frames_per_subject": 1})
    sources = open_sources(settings)
    rng = np.random.default_rng(seed)
    scenes = []
    for number, task in enumerate(make_tasks(settings, sources)):
        (face,) = sources[task.source].load([task.key])
        assert isinstance(face, Face)
        distance = rng.uniform(600, 1500)
        pose = {
            "distance_mm": distance, "yaw_deg": rng.uniform(-50, 50),
            "pitch_deg": rng.uniform(-20, 20), "x_mm": rng.uniform(-100, 100),
        }  # fmt: skip
        scene = [(face.mesh, pose_matrix(pose))]
        if number % wall_every == 2:
            scene.append(quad(distance + rng.uniform(200, 1500), albedo=0.85))
        scenes.append(scene)
    return scenes
