"""Files of single depth maps, in and out: PNG, TIFF, NPY, OpenEXR.

Whole numbers are steps of a unit (millimetres by default), as in PNG; floating numbers are metres.
0, NaN and infinity are no depth. TIFF and NPY may hold either. Maps are written as 16-bit PNG and
TIFF, and as float32 metres in NPY, OpenEXR and, if asked, TIFF. PNG files may state their step.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.exr import decode_exr, encode_exr, require_exr
from glsim.core.files.npy import encode_npy, map_npy
from glsim.core.files.png import (
    MAX_IMAGE_BYTES,
    MAX_MAP_PX,
    decode_png,
    encode_png,
    read_depth_png,
    size_problem,
    stated_unit_mm,
)
from glsim.core.files.regular import read_regular
from glsim.simulation.frame import encode_depth, refuse_millimetres, to_mm

#: Suffixes of the files that are read and written.
SUFFIXES: Final = (".png", ".tif", ".tiff", ".npy", ".exr")
_TIFF: Final = (".tif", ".tiff")
#: Formats of ``encode_map`` -> their suffixes, the usual one first. TIFF: of 16 bits.
FORMATS: Final = {
    "png": (".png",),
    "tiff": (".tiff", ".tif"),
    "tiff-float": (".tiff", ".tif"),
    "npy": (".npy",),
    "exr": (".exr",),
}
#: Formats that are written as float32 metres.
FLOAT_FORMATS: Final = ("tiff-float", "npy", "exr")
#: Channels of an OpenEXR file that hold depth, the first that there is: of glsim and grey images,
#: of Blender and of other renderers.
_EXR_CHANNELS: Final = ("Y", "Z", "depth.Z", "V", "depth.V", "R")
#: Nearest and farthest depth in metres that a file of floats may hold: those of 16-bit millimetres.
_NEAR_M, _FAR_M = 0.01, 65.535


def is_map(path: Path) -> bool:
    """Return whether a file has the suffix of a depth map."""
    return path.suffix.lower() in SUFFIXES


def format_of(path: Path) -> str:
    """Return the format of a name's suffix, with 16 bits for TIFF; "png" for other names."""
    suffix = path.suffix.lower()
    return next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "png")


def check_stated_unit(path: Path, unit_mm: float, *, inside: Path | None = None) -> None:
    """Raise DatasetError if a PNG file states another step than ``unit_mm``.

    inside: a folder that no link may lead out of.
    """
    stated_mm = stated_unit_mm(path, inside=inside)
    if stated_mm is not None and stated_mm != unit_mm:
        raise DatasetError(
            f"{path}: states steps of {stated_mm:g} mm, not {unit_mm:g}: give --depth-unit-mm "
            f"{stated_mm:g}"
        )


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
        DatasetError: no such file, no depth map, too many pixels, float millimetres, and a PNG
            file that states another step than ``unit_mm``.
        ConfigError: OpenEXR files without the package OpenEXR.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES[1:]:
        check_stated_unit(path, unit_mm, inside=inside)
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


def encode_map(
    depth_m: NDArray[np.float32],
    form: str,
    unit_mm: float,
    option: str = "--depth-unit-mm",
    *,
    state_unit: bool = False,
) -> bytes:
    """Return the file of a depth map, (H, W) metres with 0 = no depth.

    Args:
        depth_m: the map.
        form: one of FORMATS.
        unit_mm: step of whole numbers.
        option: what ``DepthRangeError`` tells to change.
        state_unit: PNG files state their step.

    Raises:
        DepthRangeError: a depth is beyond 16 bits of the unit.
    """
    if form == "npy":
        return encode_npy(depth_m)
    if form == "exr":
        return encode_exr(depth_m)
    if form == "tiff-float":
        return _encode_tiff(depth_m)
    units = encode_depth(depth_m, unit_mm, option)
    if form == "tiff":
        return _encode_tiff(units)
    return encode_png(units, unit_mm if state_unit else None)


def _encode_tiff(image: NDArray[np.uint16] | NDArray[np.float32]) -> bytes:
    import cv2

    return bytes(cv2.imencode(".tiff", image)[1].tobytes())


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
    require_exr(f"{path}: reading it")
    try:
        channels = decode_exr(read_regular(path, 4 * MAX_IMAGE_BYTES), MAX_MAP_PX)
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:
        raise DatasetError(f"{path}: {error}") from None
    if channels is None:
        raise DatasetError(f"{path}: has more than {MAX_MAP_PX} pixels")
    names = [name for name in _EXR_CHANNELS if name in channels] or list(channels)[:1]
    if not names:
        raise DatasetError(f"{path}: has no channel")
    return np.asarray(channels[names[0]])
