"""Readers of the Biwi Kinect Head Pose set's files: depth, pose and calibration."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics
from glsim.core.errors import MeshError
from glsim.faces.meshes.obj import read_bytes
from glsim.faces.scans.file_source import one_bad_file

_MAX_SIDE: Final = 2048
_MAX_TEXT: Final = 10_000

_PIXEL_CENTRE: Final = 0.5  # calibrations by OpenCV have the centre of the first pixel at 0
_ROTATION_TOLERANCE: Final = 0.02


@dataclass(frozen=True, eq=False)
class HeadPose:
    """A recorded head pose: x_camera_mm = rotation @ x_template_mm + centre_mm.

    Camera axes: x right, y down, z away.

    Args:
        rotation: (3, 3).
        centre_mm: (3,).
    """

    rotation: NDArray[np.float64]
    centre_mm: NDArray[np.float64]


def read_depth_bin(path: Path) -> NDArray[np.uint16]:
    """Read a depth file as (H, W) uint16 mm, 0 = no depth. Raises MeshError.

    Format: int32 width, int32 height, then runs until all pixels are covered: int32 number of
    empty pixels, int32 number of full pixels, and the int16 depths of the full ones.
    """
    with one_bad_file(path):
        data = read_bytes(path, 8 + 10 * _MAX_SIDE**2)
        width, height = struct.unpack_from("<ii", data)
        if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE):
            raise ValueError(f"an image of {width} x {height} pixels")
        pixels = np.zeros(width * height, np.int16)
        at, done = 8, 0
        while done < len(pixels):
            empty, full = struct.unpack_from("<ii", data, at)
            if empty < 0 or full < 0 or not 0 < empty + full <= len(pixels) - done:
                raise ValueError(f"a run of {empty} empty and {full} full pixels at pixel {done}")
            done += empty + full
            pixels[done - full : done] = np.frombuffer(data, "<i2", full, at + 8)
            at += 8 + 2 * full
        if at != len(data) or (pixels < 0).any():
            raise ValueError("bytes follow the last pixel, or depths are negative")
    return pixels.astype(np.uint16).reshape(height, width)


def read_pose(path: Path) -> HeadPose:
    """Read ``frame_*_pose.txt``: three rows of a rotation, then the head's centre in mm.

    Raises MeshError.
    """
    numbers = _numbers(path, 12)
    rotation, centre = numbers[:9].reshape(3, 3), numbers[9:]
    bounded = np.abs(rotation).max() < 1 + _ROTATION_TOLERANCE
    error = np.abs(rotation @ rotation.T - np.eye(3)).max() if bounded else np.inf
    if not (error < _ROTATION_TOLERANCE and np.linalg.det(rotation) > 0):
        raise MeshError(f"{path}: its first nine numbers are no rotation; copy it again")
    if np.abs(centre).max() > 1e5:
        raise MeshError(f"{path}: the head is {np.abs(centre).max():.4g} mm away; copy it again")
    return HeadPose(rotation, centre)


def read_calibration(path: Path) -> Intrinsics:
    """Read ``depth.cal`` or ``rgb.cal`` as intrinsics in glsim's pixel coordinates.

    Format: 3x3 matrix, 4 distortions, 3x3 rotation, 3 translations (mm), width and height. Raises
    MeshError, also for lens distortion other than 0, which no known file has.
    """
    numbers = _numbers(path, 27)
    (fx, skew, cx), (_, fy, cy), _ = numbers[:9].reshape(3, 3)
    width, height = numbers[25:]
    valid = 1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE and fx > 0 and fy > 0
    if not valid or skew or numbers[9:13].any():
        raise MeshError(f"{path}: no plain pinhole (skewed, distorted or of no size)")
    centre = float(cx) + _PIXEL_CENTRE, float(cy) + _PIXEL_CENTRE
    return Intrinsics(int(width), int(height), float(fx), float(fy), *centre)


def _numbers(path: Path, count: int) -> NDArray[np.float64]:
    """Read a small text file of exactly ``count`` numbers. Raises MeshError."""
    with one_bad_file(path):
        numbers = np.array([float(word) for word in read_bytes(path, _MAX_TEXT).split()])
        if len(numbers) != count or not np.isfinite(numbers).all():
            raise ValueError(f"it holds {len(numbers)} numbers, not {count} finite ones")
    return numbers
