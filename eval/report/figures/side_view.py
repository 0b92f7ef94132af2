"""Side view of a depth map: its shaded surface, cut at depth jumps and turned to the side."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.depth_map import FLYING_MM, surface
from glsim.core.pose import pose_matrix
from glsim.core.units import to_metres
from glsim.data.contact_sheet import shaded
from glsim.eval.report.figures.style import matplotlib

#: Colour of flying pixels.
FLYING: Final = "#dc1e1e"
#: Yaw of the head in the side view, degrees.
TURN_DEG: Final = 30.0
#: Camera of the side view, which a face fills: side of the image, px; focal length, px; distance.
_SIDE, _FOCAL, _DISTANCE_MM = 420, 1050.0, 900.0
#: Factors from camera axes to view axes (x right, y up, z towards the camera).
_TO_VIEW: Final = np.array([1.0, -1.0, -1.0])
_VIEW: Final = Intrinsics(_SIDE, _SIDE, _FOCAL, _FOCAL, _SIDE / 2, _SIDE / 2)
#: Triangles steeper than this angle to the sensor, degrees, are not drawn. Chosen by eye: at 88,
#: thin surfaces join cheeks and ears; at 80, noise of kinect-v2-paper tears holes into foreheads.
STEEPEST_DEG: Final = 83.0


def half_width_mm() -> float:
    """Compute half the width of a side view at the depth of the head's middle, mm."""
    return _SIDE / 2 * _DISTANCE_MM / _FOCAL


def side_view(prediction: Depth, clean: Depth, intrinsics: Intrinsics) -> NDArray[np.uint8]:
    """Draw the shaded surface of (H, W) mm turned by TURN_DEG, with flying pixels as red dots.

    Returns (S, S, 3) RGB.
    """
    picture = np.full((_SIDE, _SIDE, 3), 255, np.uint8)
    mesh = surface(to_metres(prediction), SensorRig(intrinsics), STEEPEST_DEG)
    if mesh is None or not (clean > 0).any():
        return picture
    seen = intrinsics.unproject(clean)[clean > 0] * _TO_VIEW
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    column, row = np.floor(intrinsics.project(mesh.vertices_mm * _TO_VIEW)).astype(np.int64).T
    colour = shaded(to_metres(prediction), intrinsics)[row, column, ::-1]
    corners, z_mm = _project(mesh.vertices_mm - middle)
    order = np.argsort(-z_mm[mesh.faces].mean(axis=1))
    for face in mesh.faces[order]:  # the farthest first
        cv2.fillConvexPoly(picture, corners[face], colour[face[0]].tolist())
    flying = (prediction > 0) & ((clean <= 0) | (np.abs(prediction - clean) > FLYING_MM))
    red = 255 * np.array(matplotlib("colors").to_rgb(FLYING))
    dots, _ = _project(intrinsics.unproject(prediction)[flying] * _TO_VIEW - middle)
    for x, y in dots:
        cv2.rectangle(picture, (int(x) - 1, int(y) - 1), (int(x) + 1, int(y) + 1), red.tolist(), -1)
    return picture


def _project(points_mm: NDArray[np.floating]) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Project (N, 3) points into the picture: (N, 2) px, and (N,) distances, mm."""
    view = pose_matrix({"yaw_deg": TURN_DEG, "distance_mm": _DISTANCE_MM})
    turned = (points_mm @ view[:3, :3].T + view[:3, 3]).astype(np.float64)
    return np.floor(_VIEW.project(turned)).astype(np.int32), turned[:, 2]
