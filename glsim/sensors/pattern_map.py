"""Maps of one device's own fixed pattern: read them for a sensor, subtract them from depth.

A map is what ``glsim fit`` writes: a .npy file, float32 (rows, columns) of the sensor's image, mm,
how much too far each pixel measures in every frame. NaN = unknown.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.files.npy import map_npy
from glsim.noise.layer_names import NO_PATTERN

#: Errors beyond this are no fixed pattern but depth in another unit, mm: the limit of the stage's
#: own parameters. The whole pattern of a Kinect V2 is 0.7 to 0.9 mm (standard deviation).
LARGEST_MM = 20.0


@dataclass(frozen=True, eq=False)
class PatternMap:
    """The fixed pattern of a device.

    Args:
        error_mm: (H, W) float32, read-only, NaN = unknown.
        file: where it was read from.
    """

    error_mm: NDArray[np.float32]
    file: Path

    @property
    def digest(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the values: equal maps, equal digests."""
        return hashlib.sha256(self.error_mm.tobytes()).hexdigest()[:16]

    @property
    def layer(self) -> NDArray[np.float32]:
        """The map as stages read it: NO_PATTERN instead of NaN."""
        return np.where(np.isfinite(self.error_mm), self.error_mm, NO_PATTERN).astype(np.float32)


def read_pattern_map(file: Path, shape: tuple[int, int]) -> PatternMap:
    """Read a .npy map for images of shape (height, width).

    Raises ConfigError for a missing or unreadable file, another shape, values that are no real
    numbers, infinite or larger than LARGEST_MM, and for a map that knows no pixel.
    """
    try:
        values = map_npy(file)
    except FileNotFoundError:
        raise ConfigError(
            f"{file}: no such file: rig.fixed_pattern_map names a map that glsim fit wrote, from "
            "the folder of the sensor file"
        ) from None
    except OSError as error:
        raise ConfigError(f"{file}: is no readable .npy file: {error.strerror}") from None
    if values.dtype.kind != "f":
        raise ConfigError(f"{file}: must be one array of floats (mm)")
    check_shape(values, shape, str(file))
    known = np.isfinite(values)
    if np.isinf(values).any():
        raise ConfigError(f"{file}: holds infinite values; mark unknown pixels with NaN")
    if not known.any():
        raise ConfigError(f"{file}: knows no pixel (all are NaN): fit it to a recording of a wall")
    if (largest := float(np.abs(values[known]).max())) > LARGEST_MM:
        raise ConfigError(
            f"{file}: has errors of up to {largest:.4g} mm, the limit is {LARGEST_MM:g}: give mm"
        )
    error_mm = np.ascontiguousarray(values, np.float32)
    error_mm.flags.writeable = False
    return PatternMap(error_mm, file)


def check_shape(values: NDArray[np.floating], shape: tuple[int, int], where: str) -> None:
    """Raise ConfigError if a map is not (height, width)."""
    if values.shape != shape:
        size = "x".join(map(str, values.shape[::-1]))
        raise ConfigError(
            f"{where}: the map of the fixed pattern is {size}, the image {shape[1]}x{shape[0]}"
        )


def remove_fixed_pattern(
    depth_mm: NDArray[np.number], map_mm: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Subtract a device's fixed pattern: float32 mm, of the shape of ``depth_mm``.

    For a crop give the same crop of the map.

    Args:
        depth_mm: (..., H, W) of any type; 0 or NaN = no depth, and stays so.
        map_mm: (H, W) errors of the same pixels, as ``glsim fit`` writes them; where it is NaN
            depth is unchanged.

    Raises:
        ConfigError: the shapes differ.
    """
    check_shape(map_mm, depth_mm.shape[-2:], "remove_fixed_pattern")
    depth = np.asarray(depth_mm, np.float32)
    change = np.nan_to_num(np.asarray(map_mm, np.float32), nan=0.0)
    return np.where(depth > 0, depth - change, depth)
