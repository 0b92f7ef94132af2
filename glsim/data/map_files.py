"""Formats of depth maps. Read and written: PNG, TIFF, NPY, OpenEXR. Read: PFM, PGM, NPZ, dumps.

Integers are steps of a unit, by default 1 mm. Floats are metres, or millimetres if the median of
their set is that large. 0, NaN, infinity and the far plane mean no depth. PNG, which may state its
step, and TIFF are written as 16-bit integers; NPY, OpenEXR and optionally TIFF as float32 metres.
"""

from __future__ import annotations

import errno
import re
import zipfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError, counted
from glsim.core.files.exr import (
    decode_exr,
    depth_channel,
    depth_name,
    encode_exr,
    exr_pixels,
    require_exr,
)
from glsim.core.files.npy import encode_npy, map_npy
from glsim.core.files.png import MAX_MAP_PX, encode_png, is_image, read_image
from glsim.core.files.regular import MOST_HELD, open_regular, read_pixels
from glsim.core.units import MM_PER_M, UINT16_MAX, from_steps, to_steps
from glsim.data.recordings.biwi import read_depth_bin

#: Suffixes of the files that are read and written.
SUFFIXES: Final = (".png", ".tif", ".tiff", ".npy", ".exr")
#: Suffixes of other files with one map or a stack, which are read only.
READ_ONLY: Final = (".pfm", ".pgm", ".npz")
#: Suffixes of dumps by libfreenect2, and of Biwi's depth.bin, which are read only.
DUMPS: Final = (".bin", ".raw", ".depth", ".ir")
#: Message for files of any other format.
READABLE: Final = (
    f"glsim reads depth in {', '.join((*SUFFIXES, *READ_ONLY))} and recordings .bag, .mcap, .mkv: "
    "convert others (videos of 8 bits hold no depth)"
)
#: (H, W) of a Kinect V2's images; dumps of libfreenect2 do not state their size.
DUMP_SHAPE: Final = (424, 512)
#: File name of a Biwi recording's calibration, in the folder of its frames.
BIWI_CALIBRATION: Final = "depth.cal"
#: Format of ``encode_map`` -> its suffixes, the default first. "tiff" has 16 bits.
FORMATS: Final = {
    "png": (".png",),
    "tiff": (".tiff", ".tif"),
    "tiff-float": (".tiff", ".tif"),
    "npy": (".npy",),
    "exr": (".exr",),
}
#: Formats that are written as float32 metres.
FLOAT_FORMATS: Final = ("tiff-float", "npy", "exr")
#: Depths of at least this value, mm, are no surface, but a renderer's far plane or the largest
#: number of a type (65504 for 16-bit floats). SATURATED, the largest 16-bit integer, is no depth.
FAR_MM: Final = 65_500.0
SATURATED: Final = 65535
#: Where a user states the unit of integers; and the note about integers without one, and about
#: their median, m.
STATED_BY: Final = "by --depth-unit-mm, or unit_mm in a camera.toml"
TAKEN_FOR_MM: Final = (
    "nothing states a unit: whole numbers are taken for mm, which puts the middle at {:.3g} m: "
    f"state another {STATED_BY}"
)
#: Floats are metres if their median is below the first number, millimetres if it is at least the
#: second: faces are recorded from 0.2 to 20 m. A median between them would be centimetres.
_METRES_BELOW, _MILLIMETRES_FROM = 20.0, 200.0
#: Smallest number of different values in a map that are not all multiples of 8 or 257 by chance.
_LEAST_VALUES = 32
#: Integers without a stated unit are refused as millimetres if too many pixels are deeper than the
#: first number, mm: the second number is their share, the third their share in maps that reach
#: 65535, as stretched maps do. Wrong matches of a real D435 have a share of 0.026.
_DEEPEST_MM, _DEEP_SHARE, _STRETCHED_SHARE = 20_000, 0.2, 0.05
#: A depth difference of this share of the median is a jump. Chosen. The last axis is time if its
#: oddness (``_frames_are_last``) is above that of the others by the second number: at most 0.7 for
#: 66 stacks of seven real and three simulated recordings, 1.6 to 14 for moving ones turned.
_JUMP_SHARE, _ODDER = 0.05, 1.2
#: Largest header of a PGM or PFM file, bytes. Chosen.
_HEADER_BYTES: Final = 1 << 16
#: Suffixes of files that may hold several maps.
STACKS: Final = (".npy", ".npz")


def format_of(path: Path) -> str:
    """Return the format for the suffix of a name; "png" for an unknown suffix."""
    suffix = path.suffix.lower()
    return next((name for name, suffixes in FORMATS.items() if suffix in suffixes), "png")


def read_stored(
    path: Path, number: int | None = None, *, inside: Path | None = None,
    channel: str | None = None, infrared: bool = False,
) -> NDArray[Any]:  # fmt: skip
    """Read one map as stored, (H, W) uint16 or float; infrared may have 8 bits.

    Axes of length 1 are dropped. Of channels with equal values, one is returned.

    Args:
        path: the file; a suffix that is neither in SUFFIXES nor in DUMPS is read as PNG.
        number: number of the map in a stack; None if the file has one map.

    Raises DatasetError: no such file, no depth map, too many pixels; ConfigError: OpenEXR files
    without the package OpenEXR.
    """
    suffix = path.suffix.lower()
    if suffix in STACKS:
        stack = open_stack(path)
        if number is None and len(stack) > 1:
            raise DatasetError(
                f"{path}: is a stack of {len(stack)} maps, not one: save each by itself"
            )
        if (number or 0) >= len(stack):
            count = counted(len(stack), "frame")
            raise DatasetError(f"{path}: has {count}, frame {number} is needed")
        return _whole_numbers(np.array(stack[number or 0]), path)
    if suffix in DUMPS:
        return _read_dump(path)
    if suffix == ".exr":
        values = _read_exr(path, channel)
    elif suffix in READ_ONLY:
        values = _read_netpbm(path)
    elif suffix in SUFFIXES or is_image(path):
        values = read_image(path, inside=inside)
    else:
        raise DatasetError(f"{path}: {READABLE}")
    return _whole_numbers(_checked(_squeezed(values), path, 2, infrared), path)


def open_stack(path: Path) -> NDArray[Any]:
    """Open a ``.npy`` file, mapped from the disk, or the depth of an ``.npz`` file, as (T, H, W).

    Raises DatasetError for a damaged file, and for a stack with the axes (rows, columns, frames).
    """
    try:
        values = map_npy(path) if path.suffix.lower() == ".npy" else _read_npz(path)
    except OSError as error:
        kind = path.suffix.lower()
        raise DatasetError(f"{path}: is no readable {kind} file: {error.strerror}") from None
    stack = _squeezed(values)
    stack = _checked(stack if stack.ndim == 3 else stack[None], path, 3)
    if len(stack) > 1 and _frames_are_last(stack):
        raise DatasetError(
            f"{path}: is {stack.shape}, whose last axis is time: a stack is (frames, rows, "
            "columns): save np.moveaxis(array, -1, 0)"
        )
    return stack


def _frames_are_last(stack: NDArray[Any]) -> bool:
    """Return whether a stack's last axis is time, by its length and by where depth jumps.

    Along time far more pixels jump than along rows and columns if the scene moves, far fewer if it
    is still; rows and columns are alike.
    """
    short, long = sorted(stack.shape[:2])
    if long > 4 * short:  # no image is narrower than 1 : 4
        return False
    if 4 * stack.shape[2] <= short:
        return True
    rates = []
    for axis in range(3):
        part = stack[tuple(slice(None) if n == axis else slice(None, None, 2) for n in range(3))]
        with np.errstate(all="ignore"):  # NaN, infinity and 1e300 are no depth
            change = np.abs(np.diff(part.astype(np.float32), axis=axis))
            middle = float(np.median(part[part > 0])) if (part > 0).any() else 0.0
            rates.append(((change > _JUMP_SHARE * middle).sum() + 0.5) / max(change.size, 1))
    logs = np.log(rates)
    odd = [abs(logs[k] - (rest := np.delete(logs, k)).mean()) - np.ptp(rest) for k in range(3)]
    return bool(odd[2] > max(odd[:2]) + _ODDER)


def _read_npz(path: Path) -> NDArray[Any]:
    """Return the array of an ``.npz`` file that is named depth, or the only one. Raises OSError."""
    with open_regular(path) as file:
        try:
            with np.load(file, allow_pickle=False) as arrays, zipfile.ZipFile(file) as members:
                if sum(member.file_size for member in members.infolist()) > MOST_HELD:
                    raise ValueError("unpacks to too many bytes")
                names = [n for n in arrays.files if "depth" in n.lower()] or arrays.files
                if len(names) != 1:
                    raise ValueError(f"holds {', '.join(arrays.files)}: save the depth alone")
                return np.asarray(arrays[names[0]])
        except Exception as error:  # a damaged ZIP file or header raises many kinds
            raise OSError(errno.EINVAL, " ".join(str(error).split())[:200]) from None


def _read_netpbm(path: Path) -> NDArray[Any]:
    import cv2

    data = read_pixels(path, _netpbm_pixels)
    if not 0 < _netpbm_pixels(data) <= MAX_MAP_PX:
        raise DatasetError(f"{path}: is no grey PGM or PFM file of at most {MAX_MAP_PX} pixels")
    with suppress(cv2.error):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if image is not None:
            return np.asarray(image)
    raise DatasetError(f"{path}: is cut short or damaged")


def _netpbm_pixels(data: Any) -> int:
    head = re.match(rb"P[25f]\s+(?:#[^\n]*\n\s*)*(\d{1,5})\s+(\d{1,5})\s", data[:_HEADER_BYTES])
    return 0 if head is None else int(head[1]) * int(head[2])


def _squeezed(values: NDArray[Any]) -> NDArray[Any]:
    """Drop axes of length 1, alpha, and all but one of colour channels with equal values."""
    while values.ndim > 2 and 1 in values.shape:
        values = values.squeeze(values.shape.index(1))
    if values.ndim > 2 and values.shape[-1] in (3, 4) and _holds_depth(values):
        first, *others = (values[..., k] for k in range(3))
        if all(np.array_equal(first, other, values.dtype.kind == "f") for other in others):
            return first
    return values


def _holds_depth(values: NDArray[Any]) -> bool:
    return values.dtype.kind == "f" or (values.dtype.kind in "iu" and values.dtype.itemsize > 1)


def _whole_numbers(image: NDArray[Any], path: Path) -> NDArray[Any]:
    """Convert integers of other types to uint16. Raises DatasetError if they do not fit."""
    if image.dtype.kind not in "iu" or image.dtype in (np.uint16, np.uint8):
        return image
    if image.min() < 0 or image.max() > UINT16_MAX:
        raise DatasetError(
            f"{path}: has whole numbers from {image.min()} to {image.max()}; depth is 0 to "
            f"{UINT16_MAX} steps: convert it to float metres"
        )
    return image.astype(np.uint16)


def _checked(values: NDArray[Any], path: Path, axes: int, infrared: bool = False) -> NDArray[Any]:
    """Return maps in the machine's byte order. Raises DatasetError for arrays that are no maps."""
    shape = values.shape
    known = _holds_depth(values) or (infrared and values.dtype.itemsize == 1)
    if values.ndim != axes or 0 in shape or not known or (axes == 3 and shape[-1] <= 4):
        raise DatasetError(
            f"{path}: is {shape[1:] if axes == 3 and shape[0] == 1 else shape} {values.dtype}: a "
            "depth map is (H, W), a stack (T, H, W), 16-bit whole numbers or float metres"
        )
    if shape[-1] * shape[-2] > MAX_MAP_PX:
        raise DatasetError(f"{path}: has more than {MAX_MAP_PX} pixels")
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def floats_in_metres(images: Iterable[NDArray[Any]], where: Path) -> bool:
    """Return whether the floats of a set of maps are metres (not millimetres), by their median.

    Integers are ignored, and so is a background: the farthest depth, if many pixels have it. Raises
    DatasetError: the median fits neither metres nor millimetres.
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


def refuse_other_unit(image: NDArray[Any], depth_mm: NDArray[np.float32], where: Path) -> None:
    """Raise DatasetError for floats of another unit than most in their folder, as ``depth_mm``."""
    seen = image[np.isfinite(image) & (image > 0)]
    if seen.size and np.ptp(seen) > 0 and depth_mm.max() < _METRES_BELOW:
        raise DatasetError(
            f"{where}: its floats, around {np.median(seen):.4g}, have another unit than most in "
            "this folder: convert them"
        )


def doubt_of_steps(image: NDArray[Any], where: Path) -> str:
    """Return a remark about integers without a stated unit, which are taken for millimetres.

    Raises DatasetError for numbers shifted by 3 or 4 bits (Kinect V1), 8-bit numbers times 257, and
    numbers stretched to 16 bits (relative or inverse depth).
    """
    seen = image[(image > 0) & (image < FAR_MM)]
    values = np.unique(seen)
    for step in (257, 16, 8):
        if len(values) >= _LEAST_VALUES and not (values % step).any():
            raise DatasetError(
                f"{where}: all values are multiples of {step}: state the unit {STATED_BY}: "
                f"{1 / step:.5g} if they are shifted (raw data of a Kinect V1), else their step"
            )
    limit = _STRETCHED_SHARE if image.max() == SATURATED else _DEEP_SHARE
    if seen.size and (share := float((seen > _DEEPEST_MM).mean())) > limit:
        raise DatasetError(
            f"{where}: {100 * share:.0f} % of its values are above {_DEEPEST_MM}, 20 m in "
            f"millimetres: state the unit {STATED_BY}; relative or inverse depth is not read"
        )
    return TAKEN_FOR_MM.format(np.median(seen) / MM_PER_M) if seen.size else ""


def refuse_negative(image: NDArray[Any], where: Path) -> None:
    """Raise DatasetError for floats of a camera that looks along -z."""
    if image.dtype.kind == "f" and (image < 0).sum() > (image > 0).sum():
        raise DatasetError(f"{where}: most of its depths are negative: negate z of such a camera")


def doubt_of_floats(image: NDArray[Any]) -> str:
    """Return a remark if floats may be scaled, or a depth buffer: they end at exactly 1."""
    # fmin and fmax say nothing if all values are NaN, unlike nanmin and nanmax.
    if image.dtype.kind != "f" or np.fmin.reduce(image, None) < 0:
        return ""
    remark = "its floats end at exactly 1: they are taken for metres; convert scaled depth"
    return remark if np.fmax.reduce(image, None) == 1 else ""


def depth_in_mm(
    image: NDArray[Any], unit_mm: float, offset_mm: float = 0.0, *, in_metres: bool = True
) -> NDArray[np.float32]:
    """Convert depth to float32 mm; NaN, values <= 0 and values >= FAR_MM become 0, no depth.

    Args:
        image: integers in steps of the unit (65535 = no depth), or floats.
        offset_mm: depth that is added to integers, see ``from_steps``.
        in_metres: whether floats are metres; if not, they are millimetres.
    """
    with np.errstate(over="ignore"):
        if image.dtype.kind == "f":
            depth_mm = image.astype(np.float32) * np.float32(1000 if in_metres else 1)
        else:
            depth_mm = from_steps(image, unit_mm, offset_mm)
            depth_mm[image == SATURATED] = 0
    depth_mm[~((depth_mm > 0) & (depth_mm < FAR_MM))] = 0
    return depth_mm


def along_ray(path: Path, channel: str | None = None) -> str:
    """Return the OpenEXR channel with distances along rays; "" if the file has depths."""
    with suppress(ValueError):
        channels = decode_exr(read_pixels(path, exr_pixels), MAX_MAP_PX)
        name = depth_name(channels, channel) if channels else ""
        return name if re.search(r"\.t$|dist|range", name) else ""
    return ""


def encode_map(depth_m: NDArray[np.float32], form: str, unit_mm: float, sensor: str = "") -> bytes:
    """Encode a depth map as the bytes of a file.

    Raises DepthRangeError: a depth is beyond 16 bits of the unit.

    ``depth_m``: (H, W) metres, 0 = no depth.
    """
    if form in FLOAT_FORMATS:
        encode = {"npy": encode_npy, "exr": encode_exr}.get(form, _encode_tiff)
        return encode(depth_m)
    units = to_steps(depth_m, unit_mm)
    return encode_png(units, unit_mm, sensor) if form == "png" else _encode_tiff(units)


def _encode_tiff(image: NDArray[np.uint16] | NDArray[np.float32]) -> bytes:
    import cv2

    return bytes(cv2.imencode(".tiff", image)[1].tobytes())


def _read_dump(path: Path) -> NDArray[Any]:
    if path.with_name(BIWI_CALIBRATION).is_file():
        return read_depth_bin(path)
    data, (height, width) = read_pixels(path, lambda _: 0), DUMP_SHAPE
    if len(data) != 4 * height * width:
        raise DatasetError(
            f"{path}: has {len(data)} bytes; a dump of libfreenect2's Frame has 512 x 424 float32 "
            f"({4 * height * width}): decode raw packets with libfreenect2 first; "
            f"{READABLE}"
        )
    return np.frombuffer(data, "<f4").reshape(DUMP_SHAPE)


def _read_exr(path: Path, channel: str | None) -> NDArray[Any]:
    require_exr(f"{path}: reading it")
    data = read_pixels(path, exr_pixels)
    try:
        channels = decode_exr(data, MAX_MAP_PX)
        if channels is None:
            raise ValueError(f"has more than {MAX_MAP_PX} pixels, or too many channels")
        return depth_channel(channels, channel)
    except ValueError as error:
        raise DatasetError(f"{path}: {error}") from None
