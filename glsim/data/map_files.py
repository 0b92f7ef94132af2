"""Files of single depth maps, in and out: PNG, TIFF, NPY, OpenEXR; dumps of two programs, in.

Whole numbers are steps of a unit (millimetres by default), as in PNG; floating numbers are metres,
or millimetres if the median of their set says so. 0, NaN, infinity and a far plane are no depth.
Maps are written as 16-bit PNG and TIFF, and as float32 metres in NPY, OpenEXR and, if asked, TIFF.
PNG files may state their step.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError
from glsim.core.files.exr import decode_exr, depth_channel, encode_exr, require_exr
from glsim.core.files.npy import encode_npy, map_npy
from glsim.core.files.png import (
    MAX_IMAGE_BYTES,
    MAX_MAP_PX,
    encode_png,
    read_image,
)
from glsim.core.files.regular import read_data
from glsim.core.units import from_steps, to_steps
from glsim.data.recordings.biwi import read_depth_bin

#: Suffixes of the files that are read and written.
SUFFIXES: Final = (".png", ".tif", ".tiff", ".npy", ".exr")
#: Those of dumps of libfreenect2, and of Biwi's depth.bin, which are read only.
DUMPS: Final = (".bin", ".raw", ".depth", ".ir")
#: Size of a Kinect V2's images, which a dump of libfreenect2 does not state.
DUMP_SHAPE: Final = (424, 512)
#: Calibration of a Biwi recording, in the folder of its frames.
BIWI_CALIBRATION: Final = "depth.cal"
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
#: Depth from here on is the far plane of a renderer or the largest number of a type, no surface,
#: mm: 65504 is the largest 16-bit float. SATURATED is so for 16-bit integers of any step.
FAR_MM: Final = 65_500.0
SATURATED: Final = 65535
#: What commands say of whole numbers without a stated unit.
TAKEN_FOR_MM: Final = "nothing states a unit: whole numbers are taken for mm (--depth-unit-mm)"
#: Middle depth of a set of floats: metres below the first, millimetres from the second on. No face
#: is recorded from more than 20 m or less than 0.2 m; centimetres lie between.
_METRES_BELOW, _MILLIMETRES_FROM = 20.0, 200.0
#: Values of a map that are no multiples of 8 by chance.
_LEAST_VALUES = 32


def format_of(path: Path) -> str:
    """Return the format of a name's suffix, with 16 bits for TIFF; "png" for other names."""
    suffix = path.suffix.lower()
    return next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "png")


def read_stored(
    path: Path,
    number: int | None = None,
    *,
    inside: Path | None = None,
    channel: str | None = None,
    infrared: bool = False,
) -> NDArray[Any]:
    """Read one map as stored, (H, W) uint16 or float; infrared may have 8 bits.

    Axes of length 1 and channels that are all alike are dropped.

    Args:
        path: of one of SUFFIXES or DUMPS; others are read as PNG.
        number: of the map in a .npy stack; None if the file holds one map.
        inside: a folder that no link may lead out of.
        channel: of an OpenEXR file.
        infrared: the image is infrared.

    Raises:
        DatasetError: no such file, no depth map, too many pixels.
        ConfigError: OpenEXR files without the package OpenEXR.
    """
    suffix = path.suffix.lower()
    if suffix == ".npy":
        stack = open_stack(path)
        if number is None and len(stack) > 1:
            raise DatasetError(
                f"{path}: is a stack of {len(stack)} maps, not one: save each by itself"
            )
        if (number or 0) >= len(stack):
            raise DatasetError(f"{path}: has {len(stack)} frames, frame {number} is needed")
        return np.array(stack[number or 0])
    if suffix in DUMPS:
        return _read_dump(path)
    values = _read_exr(path, channel) if suffix == ".exr" else read_image(path, inside=inside)
    return _checked(_squeezed(values), path, 2, infrared)


def open_stack(path: Path) -> NDArray[Any]:
    """Open a ``.npy`` file as (T, H, W), mapped from the disk. Raises DatasetError."""
    try:
        stack = _squeezed(map_npy(path))
    except OSError as error:
        raise DatasetError(f"{path}: is no readable .npy file: {error.strerror}") from None
    return _checked(stack if stack.ndim == 3 else stack[None], path, 3)


def _squeezed(values: NDArray[Any]) -> NDArray[Any]:
    """Drop axes of length 1, and colour channels of depth that are all alike, with their alpha."""
    while values.ndim > 2 and 1 in values.shape:
        values = values.squeeze(values.shape.index(1))
    if values.ndim > 2 and values.shape[-1] in (3, 4) and _holds_depth(values):
        first, *others = (values[..., k] for k in range(3))
        if all(np.array_equal(first, other, values.dtype.kind == "f") for other in others):
            return first
    return values


def _holds_depth(values: NDArray[Any]) -> bool:
    return values.dtype.kind == "f" or values.dtype.str[1:] == "u2"


def _checked(values: NDArray[Any], path: Path, axes: int, infrared: bool = False) -> NDArray[Any]:
    """Return maps in the machine's byte order. Raises DatasetError for what are none."""
    shape, bits = values.shape, 8 * values.dtype.itemsize
    known = _holds_depth(values) or (infrared and bits == 8)
    if values.ndim != axes or 0 in shape or not known or (axes == 3 and shape[-1] <= 4):
        raise DatasetError(
            f"{path}: is {shape} {values.dtype}, has {shape[-1] if shape[-1] <= 4 else 1} "
            f"channels of {bits} bits; a depth map is (H, W), a stack of frames is (T, H, W), "
            "uint16 or float metres: remove other pictures from the folder"
        )
    if shape[-1] * shape[-2] > MAX_MAP_PX:
        raise DatasetError(f"{path}: has more than {MAX_MAP_PX} pixels")
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def floats_in_metres(images: Iterable[NDArray[Any]], where: Path) -> bool:
    """Decide whether the floats of a set of maps are metres, else millimetres, by their median.

    A background at one distance, the farthest of all, has no vote; whole numbers have none.

    Raises:
        DatasetError: they are neither.
    """
    floats = [image.ravel() for image in images if image.dtype.kind == "f"]
    values = np.concatenate([np.zeros(1), *floats]).astype(np.float64)
    values = values[(values > 0) & (values < FAR_MM)]
    nearer = values[values < values.max(initial=0.0)]
    middle = float(np.median(nearer if nearer.size else values)) if values.size else 0.0
    if _METRES_BELOW <= middle < _MILLIMETRES_FROM:
        raise DatasetError(
            f"{where}: the middle of its floats is {middle:.4g}, neither metres (up to "
            f"{_METRES_BELOW:g}) nor millimetres (from {_MILLIMETRES_FROM:g}): convert them"
        )
    return middle < _METRES_BELOW


def refuse_shifted(image: NDArray[Any], where: Path) -> None:
    """Raise DatasetError for whole numbers that are shifted by 3 or 4 bits, as a Kinect V1's."""
    values = np.unique(image) if image.dtype.kind == "u" else np.zeros(0, np.uint16)
    for step in (16, 8):
        if len(values) >= _LEAST_VALUES and not (values[values < SATURATED] % step).any():
            raise DatasetError(
                f"{where}: all values are multiples of {step}: give --depth-unit-mm {1 / step:g} "
                "if they are shifted (raw data of a Kinect V1), else the step that they have"
            )


def depth_in_mm(
    image: NDArray[Any], unit_mm: float, offset_mm: float = 0.0, *, in_metres: bool = True
) -> NDArray[np.float32]:
    """Return depth as float32 millimetres, 0 = no depth: NaN, values up to 0 and from FAR_MM on.

    Args:
        image: integers in steps of the unit, of which 65535 is no depth, or floats.
        unit_mm: step of integers, mm.
        offset_mm: added to integers, see ``from_steps``.
        in_metres: floats are metres, else millimetres.
    """
    with np.errstate(over="ignore"):
        if image.dtype.kind == "f":
            depth_mm = image.astype(np.float32) * np.float32(1000 if in_metres else 1)
        else:
            depth_mm = from_steps(image, unit_mm, offset_mm)
            depth_mm[image == SATURATED] = 0
    depth_mm[~((depth_mm > 0) & (depth_mm < FAR_MM))] = 0
    return depth_mm


def encode_map(
    depth_m: NDArray[np.float32],
    form: str,
    unit_mm: float,
    option: str = "--depth-unit-mm",
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
    if form in FLOAT_FORMATS:
        encode = {"npy": encode_npy, "exr": encode_exr}.get(form, _encode_tiff)
        return encode(depth_m)
    units = to_steps(depth_m, unit_mm, option)
    if form != "png":
        return _encode_tiff(units)
    return encode_png(units, unit_mm if state_unit else None)


def _encode_tiff(image: NDArray[np.uint16] | NDArray[np.float32]) -> bytes:
    import cv2

    return bytes(cv2.imencode(".tiff", image)[1].tobytes())


def _read_dump(path: Path) -> NDArray[Any]:
    if path.with_name(BIWI_CALIBRATION).is_file():
        return read_depth_bin(path)
    data, (height, width) = read_data(path, MAX_IMAGE_BYTES), DUMP_SHAPE
    if len(data) != 4 * height * width:
        raise DatasetError(
            f"{path}: has {len(data)} bytes; a dump of libfreenect2's Frame has 512 x 424 float32 "
            f"({4 * height * width}): decode raw packets with libfreenect2 first"
        )
    return np.frombuffer(data, "<f4").reshape(DUMP_SHAPE)


def _read_exr(path: Path, channel: str | None) -> NDArray[Any]:
    require_exr(f"{path}: reading it")
    data = read_data(path, 4 * MAX_IMAGE_BYTES)
    try:
        channels = decode_exr(data, MAX_MAP_PX)
        if channels is None:
            raise ValueError(f"has more than {MAX_MAP_PX} pixels, or too many channels")
        return depth_channel(channels, channel)
    except ValueError as error:
        raise DatasetError(f"{path}: {error}") from None
