"""Export formats of cameras: Open3D's JSON and ROS's YAML, with their pixel conventions.

The first pixel's centre is at (0.5, 0.5) in glsim, and at (0, 0) in OpenCV, ROS and Open3D's point
clouds, whose cx and cy are therefore smaller by 0.5. Without this change, points of a Kinect V2 at
0.9 m would shift by 1.2 mm (0.5 / 365.5 * 900).
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Distortion, Intrinsics
from glsim.data.export.exported_frame import Export
from glsim.data.recordings.camera_file import opencv_order

#: Coordinate of the first pixel's centre in glsim, px; it is 0 in OpenCV, ROS and Open3D.
HALF_PIXEL = 0.5


def centre_at_zero(camera: Intrinsics) -> NDArray[np.float64]:
    """Return the camera matrix K (3, 3) for programs whose first pixel centre is (0, 0)."""
    k = np.eye(3)
    k[0, 0], k[1, 1] = camera.fx, camera.fy
    k[0, 2], k[1, 2] = camera.cx - HALF_PIXEL, camera.cy - HALF_PIXEL
    return k


def coefficients(lens: Distortion) -> list[float]:
    """Return distortion coefficients in OpenCV's order: k1, k2, p1, p2, k3, and maybe k4 to k6."""
    return [*opencv_order(lens)] or [0.0] * 5


def open3d_json(camera: Intrinsics) -> bytes:
    """Encode a camera as Open3D's PinholeCameraParameters (JSON), placed at the origin."""
    content = {
        "class_name": "PinholeCameraParameters",
        "extrinsic": np.eye(4).T.ravel().tolist(),
        "intrinsic": {
            "height": camera.height,
            "intrinsic_matrix": centre_at_zero(camera).T.ravel().tolist(),
            "width": camera.width,
        },
        "version_major": 1,
        "version_minor": 0,
    }
    return json.dumps(content, indent=1).encode() + b"\n"


def ros_yaml(camera: Intrinsics, lens: Distortion, name: str) -> bytes:
    """Encode a camera as a calibration file (YAML) of ROS's camera_calibration_parsers."""
    k = centre_at_zero(camera)

    def matrix(title: str, rows: int, columns: int, values: list[float]) -> list[str]:
        data = ", ".join(repr(float(value)) for value in values)
        return [f"{title}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{data}]"]

    projection = np.hstack([k, np.zeros((3, 1))])
    lines = [
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"camera_name: {json.dumps(name)}",  # a JSON string is a YAML string
        *matrix("camera_matrix", 3, 3, k.ravel().tolist()),
        f"distortion_model: {'rational_polynomial' if lens.is_rational else 'plumb_bob'}",
        *matrix("distortion_coefficients", 1, len(coefficients(lens)), coefficients(lens)),
        *matrix("rectification_matrix", 3, 3, np.eye(3).ravel().tolist()),
        *matrix("projection_matrix", 3, 4, projection.ravel().tolist()),
    ]
    return "\n".join(lines).encode() + b"\n"


CAMERAS = (
    Export(
        "open3d", "camera, JSON of Open3D",
        lambda frame: [("_camera.json", open3d_json(frame.intrinsics))],
    ),
    Export(
        "ros", "camera, camera_info YAML of ROS",
        lambda frame: [("_camera_info.yaml", ros_yaml(frame.intrinsics, frame.lens, "glsim"))],
    ),
)  # fmt: skip
