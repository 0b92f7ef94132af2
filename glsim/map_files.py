"""Files of single depth maps, in and out: PNG, TIFF, NPY, OpenEXR.

Whole numbers are steps of a unit (millimetres by default), as in PNG; floating numbers are metres.
0, NaN and infinity are no depth. TIFF and NPY may hold either. Maps are written as 16-bit PNG and
TIFF, and as float32 metres in NPY and OpenEXR.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.depth_arrays import refuse_millimetres
from glsim.errors import ConfigError, DatasetError, require_package
from glsim.exports.formats.arrays import encode_exr, encode_npy
from glsim.files.npy import map_npy
from glsim.files.png import (
    MAX_IMAGE_BYTES,
    MAX_MAP_PX,
    decode_png,
    encode_png,
    read_depth_png,
    size_problem,
)
from glsim.files.regular import read_regular
from glsim.frame import encode_depth, to_mm

#: Suffixes of the files that are read and written.
SUFFIXES: Final = (".png", ".tif", ".tiff", ".npy", ".exr")
_TIFF: Final = (".tif", ".tiff")
#: Channels of an OpenEXR file that hold depth, the first that there is: of glsim and grey images,
#: of Blender and of other renderers.
_EXR_CHANNELS: Final = ("Y", "Z", "depth.Z", "V", "depth.V", "R")
#: Nearest and farthest depth in metres that a file of floats may hold: those of 16-bit millimetres.
_NEAR_M, _FAR_M = 0.01, 65.535


def is_map(path: Path) -> bool:
    """Return whether a file has the suffix of a depth map."""
    return path.suffix.lower() in SUFFIXES


def read_map_mm(
    path: Path, unit_mm: float, offset_mm: float = 0.0, *, inside: Path | None = None
) -> NDArray[np.float32]:
    """Read a depth map, (H, W) float32 millimetres, 0 = no depth.

    Args:
        path: of one of SUFFIXES; others are read as PNG.
        unit_mm: step of whole numbers.
        offset_mm: added to whole numbers, see ``to_mm``.
        inside: a folder that no link may lead out of.

    Raises:
        DatasetError: no such file, no depth map, too many pixels, and float millimetres.
        ConfigError: OpenEXR files without the package OpenEXR.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES[1:]:
        return to_mm(read_depth_png(path, inside=inside), unit_mm, offset_mm)
    values = _read_exr(path) if suffix == ".exr" else _read_array(path, suffix)
    if values.dtype == np.uint16:
        return to_mm(values, unit_mm, offset_mm)
    if values.dtype.kind != "f" or values.ndim != 2:
        raise DatasetError(
            f"{path}: is {values.shape} {values.dtype}; a depth map is (H, W), uint16 or float "
            "metres"
        )
    if values.size > MAX_MAP_PX:
        raise DatasetError(f"{path}: has more than {MAX_MAP_PX} pixels")
    seen = np.isfinite(values) & (values > 0)
    depth_m: NDArray[np.float32] = np.where(seen, values, 0).astype(np.float32)
    try:
        refuse_millimetres(depth_m, _NEAR_M, _FAR_M)
    except ConfigError as error:
        raise DatasetError(f"{path}: {error}") from None
    return depth_m * np.float32(1000)


def encode_map(depth_m: NDArray[np.float32], suffix: str, unit_mm: float) -> bytes:
    """Return the file of a depth map, (H, W) metres with 0 = no depth, by its suffix.

    Raises DepthRangeError for a depth beyond 16 bits of the unit, in PNG and TIFF.
    """
    kind = suffix.lower()
    if kind == ".npy":
        return encode_npy(depth_m)
    if kind == ".exr":
        return encode_exr(depth_m)
    units = encode_depth(depth_m, unit_mm)
    if kind in _TIFF:
        import cv2

        return bytes(cv2.imencode(".tiff", units)[1].tobytes())
    return encode_png(units)


def _read_array(path: Path, suffix: str) -> NDArray[Any]:
    try:
        if suffix == ".npy":
            mapped = map_npy(path)
            if mapped.size > MAX_MAP_PX:
                raise DatasetError(f"{path}: has more than {MAX_MAP_PX} pixels")
            return np.array(mapped)
        data = read_regular(path, 2 * MAX_IMAGE_BYTES)
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from None
    image = decode_png(data, 2 * MAX_MAP_PX)
    if image is None:
        raise DatasetError(f"{path}: {size_problem(data) or 'is no readable image'}")
    return image


def _read_exr(path: Path) -> NDArray[Any]:
    require_package("OpenEXR", f"{path}: reading it", "formats")
    import OpenEXR

    try:
        read_regular(path, 4 * MAX_IMAGE_BYTES)  # no pipe, and no larger file
        with OpenEXR.File(str(path), header_only=True) as header:
            low, high = header.header()["dataWindow"]
        if (high[0] - low[0] + 1) * (high[1] - low[1] + 1) > MAX_MAP_PX:
            raise DatasetError(f"{path}: has more than {MAX_MAP_PX} pixels")
        with OpenEXR.File(str(path), separate_channels=True) as opened:
            channels = {name: channel.pixels for name, channel in opened.channels().items()}
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from None
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DatasetError(f"{path}: is no readable OpenEXR file ({reason})") from None
    names = [name for name in _EXR_CHANNELS if name in channels] or list(channels)[:1]
    if not names:
        raise DatasetError(f"{path}: has no channel")
    return np.asarray(channels[names[0]])
