"""Images of a sensor file that are equal in every frame: fixed pattern, projector's image.

    [rig]
    fixed_pattern_map = "x_fixed_pattern.npy"
    projector_image = "dots.png"
    projector_view_deg = [90, 63]

Both are paths relative to the folder of the sensor file. ``glsim fit`` writes the map: float32
(rows, columns) of the sensor's image, the constant error of each pixel in mm, positive if too far;
NaN = unknown. The projector's image is a grey PNG of 8 or 16 bits, x to the right, y down. It fills
the projector's field of view. White is as bright as a dot's centre. Outside there is no light.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.files.npy import map_npy
from glsim.core.files.png import MAX_IMAGE_BYTES, decode_png, image_size
from glsim.core.files.regular import read_regular

#: Largest error of a fixed pattern, mm, as in the stage's parameters; a larger one means another
#: unit. A Kinect V2's pattern has a standard deviation of 0.7 to 0.9 mm.
LARGEST_MM = 20.0
#: Smallest and largest side of a projector's image, pixels. Chosen: an image of the largest size
#: has pixels of a sixth of a D435's pixel.
SMALLEST_PX, LARGEST_PX = 2, 4096

_Read = TypeVar("_Read")


@dataclass(frozen=True, eq=False)
class SensorImage:
    """An image that a sensor file names, with its values and its file.

    ``values``: (H, W) float32, read-only: errors, mm, NaN = unknown; or brightness, 0 to 1.
    """

    values: NDArray[np.float32]
    file: Path

    @property
    def digest(self) -> str:
        """The first 16 hexadecimal digits of the SHA-256 of the image's values."""
        return hashlib.sha256(self.values.tobytes()).hexdigest()[:16]


def _read(file: Path, read: Callable[[], _Read], named: str) -> _Read:
    try:
        return read()
    except FileNotFoundError:
        raise ConfigError(
            f"{file}: no such file: {named}, from the folder of the sensor file"
        ) from None
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from None


def _sensor_image(values: NDArray[np.floating], file: Path) -> SensorImage:
    image = np.ascontiguousarray(values, np.float32)
    image.flags.writeable = False
    return SensorImage(image, file)


def read_pattern_map(file: Path, shape: tuple[int, int]) -> SensorImage:
    """Read a map of a fixed pattern (.npy, float mm) for images of shape (height, width).

    Raises ConfigError for a missing or unreadable file, for another shape, for values that are not
    real, infinite or above LARGEST_MM, and for a map without a known pixel.
    """
    named = "rig.fixed_pattern_map names a map that glsim fit wrote"
    values = _read(file, lambda: map_npy(file), named)
    if values.dtype.kind != "f":
        raise ConfigError(f"{file}: must be one array of floats (mm)")
    check_shape(values, shape, str(file))
    known = np.isfinite(values)
    if np.isinf(values).any() or not known.any():
        raise ConfigError(
            f"{file}: has infinite values, or knows no pixel (all are NaN): mark unknown pixels "
            "with NaN, and fit the map to a recording of a wall"
        )
    if (largest := float(np.abs(values[known]).max())) > LARGEST_MM:
        raise ConfigError(
            f"{file}: has errors of up to {largest:.4g} mm, the limit is {LARGEST_MM:g}: give mm"
        )
    return _sensor_image(values, file)


def check_shape(values: NDArray[np.floating], shape: tuple[int, int], where: str) -> None:
    """Raise ConfigError if a map does not have the shape (height, width) of the image."""
    if values.shape != shape:
        size = "x".join(map(str, values.shape[::-1]))
        raise ConfigError(
            f"{where}: the map of the fixed pattern is {size}, the image {shape[1]}x{shape[0]}"
        )


def remove_fixed_pattern(
    depth_mm: NDArray[np.number], map_mm: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Subtract a device's fixed pattern from depth maps; return float32 mm of the same shape.

    For a crop, give the same crop of the map.

    Args:
        depth_mm: (..., H, W) of any type; 0 or NaN = no depth, which stays.
        map_mm: (H, W) errors of the pixels, from ``glsim fit``; NaN leaves the depth unchanged.

    Raises ConfigError: the shapes differ.
    """
    check_shape(map_mm, depth_mm.shape[-2:], "remove_fixed_pattern")
    depth = np.asarray(depth_mm, np.float32)
    change = np.nan_to_num(np.asarray(map_mm, np.float32), nan=0.0)
    return np.where(depth > 0, depth - change, depth)


def read_projector_image(
    file: Path, view_deg: tuple[float, float], focal_px: tuple[float, float]
) -> SensorImage:
    """Read the image that a projector projects, as float32 brightness from 0 to 1.

    Each pixel becomes the mean over the area that a camera pixel sees, so that no fine pattern is
    lost. The mean is computed in whole numbers and is equal on every machine.

    Args:
        file: a grey PNG of 8 or 16 bits, SMALLEST_PX to LARGEST_PX on each side.
        view_deg: field of view of the image, degrees: horizontal, vertical.

    Raises ConfigError: a missing file, another kind of image, or one too large or without light.
    """
    import cv2

    named = "rig.projector_image names a PNG"
    data = _read(file, lambda: read_regular(file, MAX_IMAGE_BYTES), named)
    size = image_size(data)
    fits = size is None or SMALLEST_PX <= min(size) <= max(size) <= LARGEST_PX
    image = decode_png(data) if fits else None
    if image is None or image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        shape = "" if size is None else f" ({size[0]}x{size[1]} pixels)"
        raise ConfigError(
            f"{file}: is no readable image{shape}: rig.projector_image names a grey PNG of 8 or 16 "
            f"bits, without colour or transparency, {SMALLEST_PX} to {LARGEST_PX} on each side"
        )
    if not image.any():
        raise ConfigError(f"{file}: is black: a projector's image holds some light")
    # Number of image pixels that a camera pixel sees, rounded to odd numbers.
    sides = zip(view_deg, image.shape[::-1], focal_px, strict=True)
    across, down = (
        2 * int(0.5 * min(px / (2.0 * half_tan(view) * focal), px)) + 1 for view, px, focal in sides
    )
    # Sums of whole numbers below 2^53 are exact in float64, in any order of the terms.
    sums = cv2.boxFilter(
        image.astype(np.float64), cv2.CV_64F, (across, down),
        normalize=False, borderType=cv2.BORDER_CONSTANT,
    )  # fmt: skip
    white = (2 ** (8 * image.dtype.itemsize) - 1) * across * down
    return _sensor_image(sums / np.float64(white), file)


def half_tan(view_deg: float) -> float:
    """Compute the tangent of half a field of view."""
    return float(np.tan(np.radians(0.5 * view_deg)))
