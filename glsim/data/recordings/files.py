"""Read one frame of a depth camera from its files.

16-bit integers count steps of a recording's unit. Floats are millimetres, as libfreenect2 writes
them, or metres if no value exceeds 20: no depth camera measures less than 20 mm or more than 20 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError, MeshError
from glsim.core.files.npy import map_npy
from glsim.core.files.png import MAX_IMAGE_BYTES, MAX_MAP_PX, decode_png, size_problem
from glsim.core.files.regular import read_regular
from glsim.faces.scans.biwi_files import read_depth_bin

Array = NDArray[np.float32]

#: Size of a Kinect V2's images, which a dump of libfreenect2 does not state.
DUMP_SHAPE = (424, 512)
IMAGES, DUMPS = (".png", ".tif", ".tiff"), (".bin", ".raw", ".depth", ".ir")
#: Calibration of a Biwi recording, in the folder of its frames.
BIWI_CALIBRATION = "depth.cal"
_METRES_BELOW = 20.0
#: Shortest side of a depth frame, pixels: slopes and 3 x 3 windows need some.
_LEAST_PX = 8


class FramePlace(NamedTuple):
    """Where one frame lies on the disk.

    Attributes:
        name: unique in the recording, without slashes.
        depth_file: 16-bit PNG, TIFF, ``.npy`` stack, dump of libfreenect2, or Biwi's depth.bin.
        infrared_file: the same for the infrared image; None without one.
        number: position in a stack, else 0.
    """

    name: str
    depth_file: Path
    infrared_file: Path | None
    number: int = 0


class FrameFiles:
    """Reads the frames of a recording from their files."""

    def __init__(self, places: Sequence[FramePlace]) -> None:
        """Take the places of the frames, in order."""
        self._places = tuple(places)

    def __len__(self) -> int:
        return len(self._places)

    def name(self, number: int) -> str:
        """Return the name of a frame."""
        return self._places[number].name

    def files(self, number: int) -> tuple[Path, Path | None]:
        """Return the files of depth and of infrared of a frame."""
        return self._places[number].depth_file, self._places[number].infrared_file

    def depth(self, number: int, unit_mm: float) -> tuple[Array, float]:
        """Read (H, W) float32 depth, mm, 0 = no depth, and its step, mm, 0 of floats.

        Raises DatasetError.
        """
        _, file, _, place = self._places[number]
        image = read_image(file, place)
        check_least_size(image.shape, file)
        floats = image.dtype.kind == "f"
        in_metres = floats and _in_metres(file)
        return depth_in_mm(image, unit_mm, in_metres=in_metres), 0.0 if floats else unit_mm

    def infrared(self, number: int) -> Array | None:
        """Read (H, W) float32 infrared counts, 0 to 65535; None without. Raises DatasetError."""
        _, _, file, place = self._places[number]
        if file is None:
            return None
        return np.nan_to_num(read_image(file, place, infrared=True).astype(np.float32))


def check_least_size(shape: tuple[int, ...], where: Path) -> None:
    """Raise DatasetError if an (H, W) depth frame has fewer than 8 x 8 pixels."""
    if min(shape) < _LEAST_PX:
        raise DatasetError(
            f"{where}: has {shape[1]} x {shape[0]} pixels: a depth frame has at least {_LEAST_PX} "
            f"x {_LEAST_PX}"
        )


def depth_in_mm(image: NDArray[np.generic], unit_mm: float, *, in_metres: bool) -> Array:
    """Return (H, W) float32 depth, mm, 0 = no depth.

    Args:
        image: integers in steps of the unit, or floats, whose NaN, infinite and negative values are
            no depth.
        unit_mm: step of integers, mm.
        in_metres: floats are metres, else millimetres.
    """
    if image.dtype.kind != "f":
        return np.asarray(image.astype(np.float32) * np.float32(unit_mm))
    floats = np.nan_to_num(image.astype(np.float32), posinf=0.0)
    return np.maximum(floats, np.float32(0.0)) * np.float32(1000.0 if in_metres else 1.0)


def read_image(file: Path, number: int = 0, *, infrared: bool = False) -> NDArray[np.generic]:
    """Read one (H, W) image of a file: uint16 or float; infrared may have 8 bits. DatasetError."""
    suffix = file.suffix.lower()
    if suffix == ".npy":
        stack = open_stack(file)
        if number >= len(stack):
            raise DatasetError(f"{file}: has {len(stack)} frames, frame {number} is needed")
        return np.asarray(stack[number])
    if suffix in DUMPS and file.with_name(BIWI_CALIBRATION).is_file():
        try:
            return read_depth_bin(file)
        except MeshError as error:
            raise DatasetError(str(error)) from None
    try:
        data = read_regular(file, MAX_IMAGE_BYTES)
    except OSError as error:
        raise DatasetError(f"{file}: {error.strerror or error}") from None
    if suffix in DUMPS:
        return _dump(file, data)
    image = decode_png(data, MAX_MAP_PX)
    if image is None:
        raise DatasetError(f"{file}: {size_problem(data, MAX_MAP_PX) or 'is no readable image'}")
    known = image.dtype == np.uint16 or image.dtype.kind == "f"
    if image.ndim != 2 or not (known or (infrared and image.dtype == np.uint8)):
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise DatasetError(
            f"{file}: has {channels} channels of {image.dtype.itemsize * 8} bits; a frame of "
            "a depth camera has one of 16 bits: remove other pictures from the folder"
        )
    return image


def _dump(file: Path, data: bytes) -> NDArray[np.generic]:
    height, width = DUMP_SHAPE
    if len(data) != 4 * height * width:
        raise DatasetError(
            f"{file}: has {len(data)} bytes; a dump of libfreenect2's Frame has 512 x 424 float32 "
            f"({4 * height * width}): decode raw packets with libfreenect2 first"
        )
    return np.frombuffer(data, "<f4").reshape(DUMP_SHAPE)


def open_stack(file: Path) -> NDArray[np.generic]:
    """Open a ``.npy`` stack as (T, H, W), mapped from the disk. Raises DatasetError."""
    try:
        stack: NDArray[np.generic] = map_npy(file)
    except OSError as error:
        raise DatasetError(f"{file}: is no readable .npy file: {error.strerror}") from None
    good = stack.dtype == np.uint16 or stack.dtype.kind == "f"
    if stack.ndim not in (2, 3) or not good or 0 in stack.shape:
        raise DatasetError(
            f"{file}: is {stack.dtype} {stack.shape}; a stack of frames is (T, H, W), uint16 in "
            "steps of --depth-unit-mm or float in millimetres or metres"
        )
    if stack.shape[-1] * stack.shape[-2] > MAX_MAP_PX:
        raise DatasetError(
            f"{file}: its images are {stack.shape[-1]} x {stack.shape[-2]} pixels, more than the "
            f"{MAX_MAP_PX} pixels that glsim reads"
        )
    return stack if stack.ndim == 3 else stack[None]


def _in_metres(file: Path) -> bool:
    """Whether the floats of a file are metres: no value of its first frames exceeds 20."""
    first = open_stack(file)[:8] if file.suffix.lower() == ".npy" else read_image(file)
    sample = np.asarray(first, np.float32)
    known = sample[np.isfinite(sample) & (sample > 0)]
    return bool(known.size) and float(np.max(known)) < _METRES_BELOW
