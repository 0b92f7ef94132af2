"""Scenes of known geometry, and the layers that a renderer draws of them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from moderngl import Context
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from glsim.core.camera import Distortion, Emitter, Intrinsics, SensorRig
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.faces.face_source import FaceKey
from glsim.faces.meshes.obj import encode_obj
from glsim.faces.one_mesh import OneMesh
from glsim.gl.context import make_current
from glsim.gl.targets import Readback
from glsim.render.renderer import Renderer
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.pipeline import simulate

Array = NDArray[np.floating[Any]]

#: The Kinect V2 of the shipped sensors, and its lens.
V2 = Intrinsics(512, 424, 365.456, 365.456, 254.878, 205.395)
V2_LENS = Distortion(0.0905474, -0.26819, 0.0950862)

#: A stage of the user's own.
LOUD = """#version 330 core
// loud: adds the same amount everywhere.
#include "lib/depth.glsl"
uniform float amount_mm = 7.0; //@ [0, 100; 0, 20] mm how much
uniform sampler2D u_depth;
out float depth;
void main() {
    depth = moved_by_mm(texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r, amount_mm);
}
"""

#: The pose of ``camera_mesh``: a half turn from canonical to camera axes, no distance.
AT_CAMERA = pose_matrix({})


def camera_mesh(points_m: Array, faces: NDArray[np.integer[Any]]) -> Mesh:
    """Make a mesh of (V, 3) points, camera frame, metres, to be drawn with ``AT_CAMERA``."""
    return Mesh(
        (np.asarray(points_m) * [1000, -1000, -1000]).astype(np.float32), faces.astype(np.int32)
    )


def grid_faces(rows: int, columns: int) -> NDArray[np.int32]:
    """Return triangles of a vertex grid that face the camera (rows down, columns right)."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)


def sheet(
    depth_m: Callable[[Array, Array], Array],
    x_m: tuple[float, float],
    y_m: tuple[float, float],
    cells: int = 1,
) -> Mesh:
    """Make a mesh of the surface z = depth_m(x, y) over a rectangle, camera frame, metres."""
    x, y = np.meshgrid(np.linspace(*x_m, cells + 1), np.linspace(*y_m, cells + 1))
    points = np.stack([x, y, np.broadcast_to(depth_m(x, y), x.shape)], axis=-1)
    return camera_mesh(points.reshape(-1, 3), grid_faces(cells + 1, cells + 1))


def rectangle(x_m: tuple[float, float], y_m: tuple[float, float], z_m: float) -> Mesh:
    """Make an upright rectangle at one depth."""
    return sheet(lambda x, y: np.full_like(x, z_m), x_m, y_m)


@dataclass(frozen=True)
class Plane:
    """A plane through (0, 0, z_m), its normal tilted by ``tilt_deg`` in direction ``turn_deg``."""

    z_m: float
    tilt_deg: float
    turn_deg: float = 0.0

    @property
    def normal(self) -> Array:
        """The unit normal towards the camera."""
        tilt, turn = np.radians(self.tilt_deg), np.radians(self.turn_deg)
        return np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)])

    def depth(self, rays: Array) -> Array:
        """Compute the depth at which rays (..., 2) meet the plane, metres."""
        n = self.normal
        return np.asarray(self.z_m * n[2] / (rays.astype(np.float64) @ n[:2] + n[2]))

    def mesh(self, half_m: float, cells: int = 1) -> Mesh:
        """Make a square part of the plane, seen from the front."""
        n = self.normal
        span = (-half_m, half_m)
        return sheet(lambda x, y: self.z_m - (n[0] * x + n[1] * y) / n[2], span, span, cells)


def sphere(centre_m: tuple[float, float, float], radius_m: float, cells: int = 160) -> Mesh:
    """Make the half of a sphere that faces the camera (or a little more), as a grid of angles."""
    down, right = np.meshgrid(
        np.radians(np.linspace(-89, 89, cells + 1)),
        np.radians(np.linspace(-100, 100, cells + 1)),
        indexing="ij",
    )
    direction = np.stack(
        [np.cos(down) * np.sin(right), np.sin(down), -np.cos(down) * np.cos(right)], axis=-1
    )
    points = np.asarray(centre_m) + radius_m * direction
    return camera_mesh(points.reshape(-1, 3), grid_faces(cells + 1, cells + 1))


def face_mesh(cells: int = 150) -> Mesh:
    """Make an analytic face: an ellipsoid with nose, brows, eyes and lips, in canonical mm.

    The bump on the subject's left cheek (+x) makes it unlike its mirror image.
    """
    u, v = np.meshgrid(np.linspace(-0.97, 0.97, cells + 1), np.linspace(0.97, -0.97, cells + 1))
    x, y = 75.0 * u * np.sqrt(1 - v * v / 2), 100.0 * v * np.sqrt(1 - u * u / 2)

    def hump(at_x: float, at_y: float, width: float, height: float) -> Array:
        squared = ((x - at_x) / width) ** 2 + ((y - at_y) / height) ** 2
        return np.asarray(np.exp(-np.minimum(squared, 100.0)))

    z = 85.0 * np.sqrt(1 - (x / 80) ** 2 - (y / 106) ** 2) - 60.0
    z = z + 22 * hump(0, -12, 11, 14) + 9 * hump(0, 12, 9, 22) + 4 * hump(0, 42, 45, 10)
    z = z - 9 * hump(-30, 25, 14, 9) - 9 * hump(30, 25, 14, 9)
    z = z + 5 * hump(0, -48, 20, 5) - 4 * hump(0, -42, 18, 3) + 6 * hump(45, -25, 14, 14)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    return Mesh(vertices, grid_faces(cells + 1, cells + 1))


def write_obj(path: Path, mesh: Mesh) -> None:
    """Write a mesh's vertices, mm, and triangles as an OBJ file."""
    path.write_bytes(encode_obj(mesh.vertices_mm, mesh.faces))


def rig(
    *emitters_m: tuple[float, float, float], image: Intrinsics = V2, **changes: Any
) -> SensorRig:
    """Make a rig of the Kinect V2's geometry with emitters at given places."""
    return SensorRig(image, tuple(Emitter(at) for at in emitters_m), **changes)


def layers_of(
    context: Context,
    sensor: SensorRig | Renderer,
    meshes: Sequence[Mesh | tuple[Mesh, Mapping[str, float]]],
    visible: Rect | None = None,
) -> dict[str, NDArray[np.float32]]:
    """Render meshes (with their poses); paste the layers of the window into whole frames.

    Returns clean, lit, albedo (H, W), normal (H, W, 4), and "window", the four numbers of the Rect.
    """
    make_current(context)
    renderer = sensor if isinstance(sensor, Renderer) else Renderer(context, sensor)
    posed = [item if isinstance(item, tuple) else (item, {}) for item in meshes]
    readback = Readback(context)
    with renderer.render([(m, pose_matrix(pose)) for m, pose in posed], visible) as rendered:
        window = rendered.window
        layers = {n: t for n, t in rendered.layers.items() if t.layer.scale == 1}
        readback.request(rendered.pool, layers, window)
    image = renderer.rig.intrinsics
    result: dict[str, NDArray[np.float32]] = {"window": np.array(window, np.float32)}
    for name, part in readback.arrays().items():
        full = np.zeros((image.height, image.width, *part.shape[2:]), np.float32)
        full[window.slices] = part
        result[name] = full
    return result


def settings_for(sensor: str = "ideal", **overrides: Any) -> Settings:
    """Make settings for one mesh at 0.9 m, with changed tables by name."""
    return load_settings(overrides={"sensor": sensor, "source": {"kind": "folder"}} | overrides)


def frames_of(context: Context, settings: Settings, mesh: Mesh, frames: int = 1) -> list[Frame]:
    """Simulate ``frames`` frames of one mesh."""
    source = settings.source[0].model_copy(update={"frames_per_subject": frames})
    results = simulate(
        settings.model_copy(update={"source": (source,)}), sources=[OneMesh(mesh)], context=context
    )
    made = list(results)
    assert all(isinstance(frame, Frame) for frame in made), made
    return [frame for frame in made if isinstance(frame, Frame)]


def only_frame(results: Iterable[Frame | Skipped]) -> Frame:
    """Return the one frame of a simulation; fail if it was skipped."""
    (frame,) = results
    assert isinstance(frame, Frame), frame
    return frame


def interior(depth_m: Array, margin_px: int = 2) -> NDArray[np.bool_]:
    """Mark the pixels whose whole neighbourhood has depth."""
    inside: NDArray[np.bool_] = binary_erosion(depth_m > 0, np.ones((2 * margin_px + 1,) * 2))
    return inside


def rig_toml(width: int, height: int, focal_px: float) -> str:
    """Return the table [rig] of a pinhole camera with its axis in the middle of the image."""
    size, centre = f"width = {width}\nheight = {height}", [width / 2, height / 2]
    return f"[rig]\n{size}\nfocal_px = {[focal_px] * 2}\ncentre_px = {centre}\n"


#: A small pinhole camera, as a sensor file.
SMALL_RIG = 'title = "small"\n' + rig_toml(96, 80, 100.0)
SMALL_EMITTER = "[[rig.emitter]]\nposition_m = [0.05, 0, 0]\n"


def sensor_file(folder: Path, *stages: str, emitter: bool = False) -> str:
    """Write a sensor file with stages given as TOML lines; return its path."""
    tables = "".join(f"[[stage]]\n{stage}\n" for stage in stages)
    file = folder / "sensor.toml"
    file.write_text(SMALL_RIG + (SMALL_EMITTER if emitter else "") + tables)
    return str(file)


def plate() -> Mesh:
    """Make a square of 0.4 m in canonical mm, 44 x 44 pixels of the small rig at 0.9 m."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * 200
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))


class TwoSequences(OneMesh):
    """A source of one subject in two sequences of 12 frames, 30 per second."""

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        """Return the frames of both sequences, whatever ``count`` is."""
        return [FaceKey(subject, "ab"[n // 12], n % 12, (n % 12) / 30) for n in range(24)]


def moving_settings(sensor: str = "kinect-v2", **overrides: Any) -> Settings:
    """Make settings of faces that turn and move from frame to frame."""
    pose = {
        "yaw_deg": {"uniform": [-30, 30]},
        "x_mm": {"uniform": [-200, 200]},
        "distance_mm": {"uniform": [700, 1200]},
    }
    return settings_for(sensor, pose=pose, **overrides)


def assert_cut(whole: Sequence[Frame], cut: Sequence[Frame], *layers: str) -> None:
    """Check that layers of cropped frames are parts of the same whole frames, noise included."""
    for full, part in zip(whole, cut, strict=True):
        left = round(full.intrinsics.cx - part.intrinsics.cx)
        top = round(full.intrinsics.cy - part.intrinsics.cy)
        window = np.s_[top : top + len(part.clean), left : left + part.clean.shape[1]]
        for layer in layers:
            np.testing.assert_array_equal(part.image(layer), full.image(layer)[window])
