"""The pattern of a projector as an image: what it throws instead of the dots that glsim draws.

A sensor file names a grey PNG of 8 or 16 bits, from its own folder, and the field of view that it
fills:

    [rig]
    projector_image = "dots.png"
    projector_view_deg = [90, 63]

The image is what a camera in the projector's place would see on a screen: x to the right, y down.
White is as bright as a dot's centre. Outside of the field of view there is no light.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.files.png import MAX_IMAGE_BYTES, decode_png, image_size
from glsim.core.files.regular import read_regular

#: Smallest and largest side of an image, pixels. Chosen: beyond the largest a pixel is finer than
#: a sixth of a D435's pixel.
SMALLEST_PX, LARGEST_PX = 2, 4096

_SETTING = "rig.projector_image"


@dataclass(frozen=True, eq=False)
class ProjectorImage:
    """What a projector throws.

    Args:
        brightness: (H, W) float32, read-only, 0 to 1.
        view_deg: its field of view, degrees: columns, rows.
        file: where it was read from.
    """

    brightness: NDArray[np.float32]
    view_deg: tuple[float, float]
    file: Path

    def describe(self) -> dict[str, Any]:
        """Return its size, field of view and the beginning of its SHA-256, as JSON values."""
        height, width = self.brightness.shape
        digest = hashlib.sha256(self.brightness.tobytes()).hexdigest()[:16]
        return {"digest": digest, "size_px": [width, height], "view_deg": list(self.view_deg)}


def read_projector_image(
    file: Path, view_deg: tuple[float, float], focal_px: tuple[float, float]
) -> ProjectorImage:
    """Read the image that a projector throws.

    Each pixel becomes the mean over what one pixel of the camera sees of the image, so that none of
    a fine pattern is lost. The mean is taken in whole numbers: the same on every machine.

    Args:
        file: a grey PNG of 8 or 16 bits, SMALLEST_PX to LARGEST_PX on each side.
        view_deg: its field of view, degrees: columns, rows.
        focal_px: of the camera.

    Raises:
        ConfigError: the file is missing, no such image, too large or without light.
    """
    try:
        data = read_regular(file, MAX_IMAGE_BYTES)
    except FileNotFoundError:
        raise ConfigError(
            f"{file}: no such file: {_SETTING} names a PNG, from the folder of the sensor file"
        ) from None
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from None
    size = image_size(data)
    if size is not None and not SMALLEST_PX <= min(size) <= max(size) <= LARGEST_PX:
        raise ConfigError(
            f"{file}: is {size[0]}x{size[1]} pixels; a projector's image ({_SETTING}) has "
            f"{SMALLEST_PX} to {LARGEST_PX} on each side"
        )
    image = decode_png(data)
    if image is None:
        raise ConfigError(f"{file}: is no readable image: {_SETTING} names a grey PNG")
    if image.ndim != 2:
        raise ConfigError(
            f"{file}: has {image.shape[2]} channels; a projector's image ({_SETTING}) is grey, "
            "without colour or transparency"
        )
    if image.dtype not in (np.uint8, np.uint16):
        raise ConfigError(f"{file}: is {image.dtype}; a projector's image has 8 or 16 bits")
    if not image.any():
        raise ConfigError(f"{file}: is black: a projector's image ({_SETTING}) holds some light")
    sums, count = image.astype(np.int64), 1
    for axis, number in ((1, 0), (0, 1)):
        side_px = _seen_px(view_deg[number], sums.shape[axis], focal_px[number])
        sums, count = _sums_along(sums, axis, side_px), count * side_px
    white = (2 ** (8 * image.dtype.itemsize) - 1) * count
    brightness = (sums / np.float64(white)).astype(np.float32)
    brightness.flags.writeable = False
    return ProjectorImage(brightness, view_deg, file)


def half_tan(view_deg: float) -> float:
    """Return the tangent of half a field of view."""
    return float(np.tan(np.radians(0.5 * view_deg)))


def _seen_px(view_deg: float, side_px: int, focal_px: float) -> int:
    """Return the pixels of an image that one pixel of the camera sees, odd."""
    seen = side_px / (2.0 * half_tan(view_deg) * focal_px)
    return 2 * int(0.5 * min(seen, side_px)) + 1


def _sums_along(values: NDArray[np.int64], axis: int, side_px: int) -> NDArray[np.int64]:
    """Return the sums over ``side_px`` (odd) neighbours along an axis; beyond the edge is black."""
    pad = [(0, 0), (0, 0)]
    pad[axis] = (side_px // 2 + 1, side_px // 2)
    total = np.cumsum(np.pad(values, pad), axis=axis)
    count = values.shape[axis]
    last, first = (np.take(total, np.arange(count) + at, axis=axis) for at in (side_px, 0))
    return np.asarray(last - first)
