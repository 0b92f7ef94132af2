"""Read one frame of a depth camera from its files.

16-bit integers count steps of a recording's unit. Floats are metres, or millimetres, as
libfreenect2 writes them: the median of all frames decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError, MeshError
from glsim.core.files.png import MAX_IMAGE_BYTES
from glsim.core.files.regular import read_regular
from glsim.data.map_files import (
    TAKEN_FOR_MM,
    depth_in_mm,
    floats_in_metres,
    read_stored,
    refuse_shifted,
    sample,
)
from glsim.faces.scans.biwi_files import read_depth_bin

Array = NDArray[np.float32]

#: Size of a Kinect V2's images, which a dump of libfreenect2 does not state.
DUMP_SHAPE = (424, 512)
IMAGES, DUMPS = (".png", ".tif", ".tiff", ".exr"), (".bin", ".raw", ".depth", ".ir")
#: Calibration of a Biwi recording, in the folder of its frames.
BIWI_CALIBRATION = "depth.cal"
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

    def __init__(self, places: Sequence[FramePlace], channel: str | None = None) -> None:
        """Take the places of the frames, in order, and the channel of OpenEXR files."""
        self._places, self._channel = tuple(places), channel

    def __len__(self) -> int:
        return len(self._places)

    def name(self, number: int) -> str:
        """Return the name of a frame."""
        return self._places[number].name

    def unit_notes(self) -> tuple[str, ...]:
        """Return what is assumed where nothing states a unit, in lines for the user.

        Raises DatasetError if whole numbers are shifted, and for a first frame that is no map.
        """
        image = read_image(self._places[0].depth_file, channel=self._channel)
        refuse_shifted(image, self._places[0].depth_file)
        return () if image.dtype.kind == "f" else (TAKEN_FOR_MM,)

    def files(self, number: int) -> tuple[Path, Path | None]:
        """Return the files of depth and of infrared of a frame."""
        return self._places[number].depth_file, self._places[number].infrared_file

    def depth(self, number: int, unit_mm: float) -> tuple[Array, float]:
        """Read (H, W) float32 depth, mm, 0 = no depth, and its step, mm, 0 of floats.

        Raises DatasetError.
        """
        _, file, _, place = self._places[number]
        image = read_image(file, place, channel=self._channel)
        check_least_size(image.shape, file)
        if image.dtype.kind != "f":
            return depth_in_mm(image, unit_mm), unit_mm
        return depth_in_mm(image, unit_mm, in_metres=self._in_metres), 0.0

    @cached_property
    def _in_metres(self) -> bool:
        """Whether the floats of all frames are metres."""
        places = [self._places[number] for number in sample(len(self))]
        images: list[NDArray[np.generic]] = []
        for place in places:
            with suppress(DatasetError):  # reported when the frame is read
                images.append(read_image(place.depth_file, place.number, channel=self._channel))
        return floats_in_metres(images, places[0].depth_file)

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


def read_image(
    file: Path, number: int = 0, *, infrared: bool = False, channel: str | None = None
) -> NDArray[np.generic]:
    """Read one (H, W) image of a file: uint16 or float; infrared may have 8 bits. DatasetError."""
    if file.suffix.lower() not in DUMPS:
        return read_stored(file, number, infrared=infrared, channel=channel)
    try:
        if file.with_name(BIWI_CALIBRATION).is_file():
            return read_depth_bin(file)
        return _dump(file, read_regular(file, MAX_IMAGE_BYTES))
    except MeshError as error:
        raise DatasetError(str(error)) from None
    except OSError as error:
        raise DatasetError(f"{file}: {error.strerror or error}") from None


def _dump(file: Path, data: bytes) -> NDArray[np.generic]:
    height, width = DUMP_SHAPE
    if len(data) != 4 * height * width:
        raise DatasetError(
            f"{file}: has {len(data)} bytes; a dump of libfreenect2's Frame has 512 x 424 float32 "
            f"({4 * height * width}): decode raw packets with libfreenect2 first"
        )
    return np.frombuffer(data, "<f4").reshape(DUMP_SHAPE)
