"""Side view of a depth map, drawn by the simulator's renderer."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.pose import pose_matrix
from glsim.data.preview import shaded
from glsim.denoise.interface import Depth
from glsim.eval.metrics.prediction import FLYING_MM
from glsim.eval.report.figures.cut_surface import cut_surface
from glsim.eval.report.figures.map_pictures import FLYING
from glsim.eval.report.figures.style import matplotlib
from glsim.faces.one_mesh import OneMesh
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate

#: Yaw of the head in the side view, degrees.
TURN_DEG: Final = 30.0
#: Camera of the side view: a square image, px, focal length, px, and distance; a face fills it.
_SIDE, _FOCAL, _DISTANCE_MM = 420, 1050.0, 900.0
_WHITE: Final = 255


def half_width_mm() -> float:
    """Return half the width of a side view at the middle of the head, mm."""
    return _SIDE / 2 * _DISTANCE_MM / _FOCAL


def side_view(prediction: Depth, clean: Depth, intrinsics: Intrinsics) -> NDArray[np.uint8]:
    """Draw the shaded surface turned by TURN_DEG, with flying pixels as red dots.

    Args:
        prediction, clean: (H, W) millimetres.

    Returns:
        (S, S, 3) RGB.

    Raises:
        DeviceError: there is no OpenGL.
    """
    middle = _middle(clean, intrinsics)
    picture = np.full((_SIDE, _SIDE, 3), _WHITE, np.uint8)
    mesh = cut_surface(prediction, SensorRig(intrinsics))
    settings = _settings()
    if mesh is not None:
        moved = replace(mesh, vertices_mm=mesh.vertices_mm - middle)
        frames = [f for f in simulate(settings, sources=[OneMesh(moved)]) if isinstance(f, Frame)]
        if frames:
            depth = np.zeros((_SIDE, _SIDE), np.float32)
            depth[frames[0].window.slices] = frames[0].clean_m
            seen = depth > 0
            picture[seen] = shaded(depth, frames[0].intrinsics)[seen][:, ::-1]
    flying_colour = np.rint(255 * np.array(matplotlib("colors").to_rgb(FLYING)))
    flying = (prediction > 0) & ((clean <= 0) | (np.abs(prediction - clean) > FLYING_MM))
    for row, column in _project(_points(prediction, intrinsics)[flying] - middle):
        picture[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2] = flying_colour
    return picture


def _settings() -> Settings:
    half = _SIDE / 2
    rig = {
        "width": _SIDE,
        "height": _SIDE,
        "focal_px": [_FOCAL, _FOCAL],
        "centre_px": [half, half],
    }
    return load_settings(
        overrides={
            "sensor": "ideal",
            "rig": rig,
            "pose": {"yaw_deg": TURN_DEG, "distance_mm": _DISTANCE_MM},
            "output": {"depth_unit_mm": 0.1},
        },
        source={"subjects": 1, "frames_per_subject": 1},
    )


def _points(depth_mm: Depth, intrinsics: Intrinsics) -> NDArray[np.float32]:
    """Back-project to (H, W, 3) mm with x right, y up, z towards the camera."""
    turn = np.array([1, -1, -1], np.float32)
    points: NDArray[np.float32] = intrinsics.unproject(depth_mm) * turn
    return points


def _middle(clean: Depth, intrinsics: Intrinsics) -> NDArray[np.float32]:
    """Return the (3,) centre of the clean surface, mm; a point at 900 mm without depth."""
    valid = clean > 0
    if not valid.any():
        return np.array([0, 0, -_DISTANCE_MM], np.float32)
    points = _points(clean, intrinsics)[valid]
    middle: NDArray[np.float32] = ((points.min(axis=0) + points.max(axis=0)) / 2).astype(np.float32)
    return middle


def _project(points_mm: NDArray[np.float32]) -> list[tuple[int, int]]:
    """Project points to (row, column) in the picture; points outside it are left out."""
    view = pose_matrix({"yaw_deg": TURN_DEG, "distance_mm": _DISTANCE_MM})
    seen = points_mm.astype(np.float64) @ view[:3, :3].T + view[:3, 3]
    seen = seen[seen[:, 2] > 0]
    camera = Intrinsics(_SIDE, _SIDE, _FOCAL, _FOCAL, _SIDE / 2, _SIDE / 2)
    image = np.floor(camera.project(seen)).astype(np.int64)
    inside = ((image >= 0) & (image < _SIDE)).all(axis=1)
    return [(int(y), int(x)) for x, y in image[inside]]
