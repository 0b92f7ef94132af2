"""Depth files and calibrations of the Biwi Kinect Head Pose set."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics
from glsim.core.errors import DatasetError
from glsim.core.files.regular import read_data

_MAX_SIDE: Final = 2048
_MAX_TEXT: Final = 10_000
#: Coordinate of the first pixel's centre in glsim, px; it is 0 in OpenCV's calibrations.
_PIXEL_CENTRE: Final = 0.5


def read_depth_bin(path: Path) -> NDArray[np.uint16]:
    """Read a depth file as (H, W) uint16 mm, 0 = no depth. Raises DatasetError.

    Format: int32 width, int32 height, then runs until all pixels are covered: int32 number of
    empty pixels, int32 number of full pixels, and the int16 depths of the full ones.
    """
    data = read_data(path, 8 + 10 * _MAX_SIDE**2)
    try:
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
    except (struct.error, ValueError) as error:
        raise DatasetError(f"{path}: is no depth file of Biwi ({error}); copy it again") from None
    return pixels.astype(np.uint16).reshape(height, width)


def read_calibration(path: Path) -> Intrinsics:
    """Read ``depth.cal`` or ``rgb.cal`` as intrinsics in glsim's pixel coordinates.

    Format: 3x3 matrix, 4 distortions, 3x3 rotation, 3 translations (mm), width and height. Raises
    DatasetError, also for lens distortion other than 0, which no known file has.
    """
    try:
        numbers = np.array([float(word) for word in read_data(path, _MAX_TEXT).split()])
    except ValueError as error:
        raise DatasetError(f"{path}: is no calibration of Biwi ({error}); copy it again") from None
    if len(numbers) != 27 or not np.isfinite(numbers).all():
        raise DatasetError(
            f"{path}: holds {len(numbers)} numbers, not 27 finite ones: copy it again"
        )
    (fx, skew, cx), (_, fy, cy), _ = numbers[:9].reshape(3, 3)
    width, height = numbers[25:]
    valid = 1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE and fx > 0 and fy > 0
    if not valid or skew or numbers[9:13].any():
        raise DatasetError(f"{path}: no plain pinhole (skewed, distorted or of no size)")
    centre = float(cx) + _PIXEL_CENTRE, float(cy) + _PIXEL_CENTRE
    return Intrinsics(int(width), int(height), float(fx), float(fy), *centre)
