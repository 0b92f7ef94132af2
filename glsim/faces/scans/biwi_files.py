"""Read the files of the Biwi Kinect Head Pose set: depth, pose and calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics
from glsim.core.errors import MeshError
from glsim.faces.meshes.limits import check_size

_MAX_SIDE: Final = 2048
_MAX_TEXT: Final = 10_000

_PIXEL_CENTRE: Final = 0.5  # calibrations by OpenCV have the centre of the first pixel at 0
_ROTATION_TOLERANCE: Final = 0.02


@dataclass(frozen=True, eq=False)
class HeadPose:
    """A head pose: x_camera_mm = rotation @ x_template_mm + centre_mm.

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
    check_size(path, 8 + 10 * _MAX_SIDE**2)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    if len(data) < 8:
        raise MeshError(f"{path}: cut short: {len(data)} bytes hold no header; copy it again")
    width, height = (int(side) for side in np.frombuffer(data, "<i4", 2))
    if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE):
        raise MeshError(
            f"{path}: an image of {width} x {height} pixels; the file is damaged, copy it again"
        )
    pixels = np.zeros(width * height, np.int16)
    at, done = 8, 0
    while done < len(pixels):
        if at + 8 > len(data):
            raise MeshError(f"{path}: cut short at pixel {done} of {len(pixels)}; copy it again")
        empty = int.from_bytes(data[at : at + 4], "little", signed=True)
        full = int.from_bytes(data[at + 4 : at + 8], "little", signed=True)
        at += 8
        if empty < 0 or full < 0 or not 0 < empty + full <= len(pixels) - done:
            raise MeshError(
                f"{path}: a run of {empty} empty and {full} full pixels at pixel {done} of "
                f"{len(pixels)}; the file is damaged, copy it again"
            )
        if at + 2 * full > len(data):
            raise MeshError(f"{path}: cut short at pixel {done} of {len(pixels)}; copy it again")
        done += empty
        pixels[done : done + full] = np.frombuffer(data, "<i2", full, at)
        done += full
        at += 2 * full
    if at != len(data):
        raise MeshError(
            f"{path}: {len(data) - at} bytes follow the last pixel; the file is damaged"
        )
    if (pixels < 0).any():
        raise MeshError(f"{path}: {int((pixels < 0).sum())} depths are negative; it is damaged")
    return pixels.astype(np.uint16).reshape(height, width)


def read_pose(path: Path) -> HeadPose:
    """Read ``frame_*_pose.txt``: three rows of a rotation, then the head's centre in mm.

    Raises MeshError.
    """
    numbers = _numbers(path)
    if len(numbers) != 12:
        raise MeshError(f"{path}: {len(numbers)} numbers, not the 12 of a pose; copy it again")
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
    numbers = _numbers(path)
    if len(numbers) != 27:
        raise MeshError(f"{path}: {len(numbers)} numbers, not the 27 of a calibration")
    (fx, skew, cx), (_, fy, cy), _ = numbers[:9].reshape(3, 3)
    width, height = numbers[25:]
    valid = 1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE and fx > 0 and fy > 0
    if not valid or skew or numbers[9:13].any():
        raise MeshError(f"{path}: no plain pinhole (skewed, distorted or of no size)")
    return Intrinsics(
        int(width),
        int(height),
        float(fx),
        float(fy),
        float(cx) + _PIXEL_CENTRE,
        float(cy) + _PIXEL_CENTRE,
    )


def _numbers(path: Path) -> NDArray[np.float64]:
    """Read a small text file of numbers. Raises MeshError if a word is not a finite number."""
    check_size(path, _MAX_TEXT)
    try:
        numbers = np.array([float(word) for word in path.read_bytes().split()])
    except (OSError, ValueError) as error:
        raise MeshError(f"{path}: is not a text of numbers ({error}); copy it again") from None
    if not np.isfinite(numbers).all():
        raise MeshError(f"{path}: holds NaN or infinity; copy it again")
    return numbers
