"""What the tests of the time-of-flight sensors share: scenes, and shots with all layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.distribution import DrawKeys
from glsim.frame import Rect
from glsim.gl.targets import Readback
from glsim.mesh import Mesh
from glsim.noise.chain import ShaderChain, run_twins
from glsim.noise.view import FrameContext, Optics
from glsim.pipeline import draw_values
from glsim.pose import pose_matrix
from glsim.render import Renderer
from glsim.sensor import Sensor, load_sensor

Image = NDArray[np.float32]
Placed = tuple[Mesh, NDArray[np.float32]]

FRAMED = ("clean", "depth", "reason", "infrared", "lit", "decoded", "phasor_a", "phasor_b")

#: Everything that makes two frames of one scene differ from each other, or from the scene.
QUIET = {
    "tof_taps": {"read_variance": 0.0, "shot_variance": 0.0, "companding": 0.0},
    "tof_light": {"harmonic_2": 0.0, "harmonic_5": 0.0},
    "tof_floor": {"enabled": 0.0},
    "fixed_pattern": {"enabled": 0.0},
    "millimetre_quantise": {"enabled": 0.0},
}

Changes = Mapping[str, Mapping[str, float]]


def merged(*changes: Changes) -> dict[str, dict[str, float]]:
    """Parameters by stage, later ones over earlier ones."""
    result: dict[str, dict[str, float]] = {}
    for change in changes:
        for stage, values in change.items():
            result.setdefault(stage, {}).update(values)
    return result


@dataclass(eq=False)
class Camera:
    """A sensor on the tests' GL context."""

    context: moderngl.Context
    sensor: Sensor
    renderer: Renderer
    chain: ShaderChain
    readback: Readback

    @classmethod
    def open(cls, context: moderngl.Context, name: str = "kinect-v2", **rig: object) -> Camera:
        sensor = load_sensor(name, rig_overrides=rig)
        renderer = Renderer(context, sensor.rig)
        chain = ShaderChain(context, sensor.stages)
        return cls(context, sensor, renderer, chain, Readback(context))

    def frame(self, window: Rect, seed: int, device: int = 5) -> FrameContext:
        rig = self.sensor.rig
        optics = Optics.of(rig, self.renderer.nearest_m)
        size = rig.intrinsics.width, rig.intrinsics.height
        focal_baseline = rig.intrinsics.fx * rig.baseline_m
        return FrameContext(window, *size, seed, seed, device, 0.0, focal_baseline, optics)

    def values(self, changes: Changes) -> dict[str, dict[str, float]]:
        _, values = draw_values(self.sensor.stages, DrawKeys(0, 0, 0))
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
        """Layers of a frame after the whole chain, of its window."""
        layers, window = self.renderer.render(meshes, crop)
        frame, values = self.frame(window, seed, device), self.values(changes or {})
        self.chain._wanted = FRAMED
        self.chain.run(self.renderer, layers, frame, values, self.readback)
        return {name: image.copy() for name, image in self.readback.arrays().items()}

    def clean(self, meshes: Sequence[Placed]) -> tuple[dict[str, Image], Rect]:
        """The layers that the chain starts from, and their window."""
        layers, window = self.renderer.render(meshes)
        rays = self.renderer.rays
        self.readback.request(self.renderer.pool, {**layers, "rays": rays}, window)
        arrays = {name: image.copy() for name, image in self.readback.arrays().items()}
        for target in layers.values():
            self.renderer.pool.give_back(target)
        return arrays, window

    def twin(
        self, meshes: Sequence[Placed], changes: Changes | None = None, seed: int = 1
    ) -> dict[str, Image]:
        """The same as ``shoot`` through the stages' twins, from the same clean layers."""
        layers, window = self.clean(meshes)
        layers |= {"depth": layers["clean"], "reason": np.zeros_like(layers["clean"])}
        run_twins(self.sensor.stages, layers, self.frame(window, seed), self.values(changes or {}))
        return layers


def quad(
    z_mm: float,
    x_mm: tuple[float, float] = (-9000, 9000),
    y_mm: tuple[float, float] = (-9000, 9000),
    albedo: float = 1.0,
    yaw_deg: float = 0.0,
) -> Placed:
    """A rectangle across the axis at a distance (y up, as in canonical axes)."""
    corners = [[x, y, 0.0] for x, y in zip((*x_mm, *x_mm[::-1]), np.repeat(y_mm, 2), strict=True)]
    mesh = Mesh(
        np.array(corners, np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(4, albedo, np.float32),
    )
    return mesh, pose_matrix({"distance_mm": z_mm, "yaw_deg": yaw_deg})


def centre(image: Image, side: int = 64, at: tuple[int, int] = (205, 255)) -> Image:
    """The middle of a whole frame."""
    return image[at[0] - side // 2 : at[0] + side // 2, at[1] - side // 2 : at[1] + side // 2]


def residual_mm(depth_m: Image) -> NDArray[np.float64]:
    """Millimetres from the plane that fits best."""
    y, x = np.indices(depth_m.shape)
    basis = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
    z = 1000.0 * depth_m.ravel().astype(np.float64)
    return (z - basis @ np.linalg.lstsq(basis, z, rcond=None)[0]).reshape(depth_m.shape)
