"""Depth maps in files of their own: one decision on the unit of all, then one map at a time.

16-bit integers count steps of a unit. Floats are metres, or millimetres, as libfreenect2 writes
them: the median of a folder decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError
from glsim.core.files.png import stated_unit_mm
from glsim.data.map_files import (
    TAKEN_FOR_MM,
    depth_in_mm,
    floats_in_metres,
    read_stored,
    refuse_shifted,
)
from glsim.data.recordings.names import infrared_beside

Array = NDArray[np.float32]

#: Maps of a folder that its unit is decided by, and values of each.
_SAMPLE, _SAMPLE_PX = 16, 20_000


class FramePlace(NamedTuple):
    """Name and files of one depth map.

    Attributes:
        name: unique in the recording, without slashes.
        file: PNG, TIFF, OpenEXR, ``.npy``, dump of libfreenect2, or Biwi's depth.bin.
        number: position in a stack; None if the file holds one map.
    """

    name: str
    file: Path
    number: int | None = None


class MapFiles:
    """Reads depth maps and their infrared images from files.

    Attributes:
        paths: file of each map.
        step_mm: of whole numbers.
        notes: what is assumed where nothing states a unit, in lines for the user.
    """

    def __init__(
        self,
        places: Sequence[FramePlace],
        unit_mm: float | None = None,
        channel: str | None = None,
        infrared: Sequence[Path] | None = None,
        unit_wins: bool = False,
    ) -> None:
        """Decide the unit of floats for each folder.

        Args:
            places: of the maps, in order.
            unit_mm: step of whole numbers as stated or given; default: 1, which is noted.
            channel: of OpenEXR files.
            infrared: image of each map; default: those beside them.
            unit_wins: over the steps that PNG files state, as that of a camera.toml does.

        Raises:
            DatasetError: whole numbers are shifted, or floats neither metres nor millimetres.
        """
        self._places, self._channel, self._infrared = tuple(places), channel or None, infrared
        self.step_mm = unit_mm or 1.0
        self.notes: tuple[str, ...] = ()
        self._unit_wins = unit_wins
        self.paths = [place.file for place in self._places]
        folders: dict[Path, list[FramePlace]] = {}
        for place in self._places:
            folders.setdefault(place.file.parent, []).append(place)
        self._in_metres: Mapping[Path, bool] = {
            folder: self._floats_in_metres(own, unit_mm is None) for folder, own in folders.items()
        }
        if not all(self._in_metres.values()):
            floats = "floats are taken for mm: their median is too large for metres"
            self.notes = (*self.notes, floats)

    def __len__(self) -> int:
        return len(self._places)

    def name(self, number: int) -> str:
        """Return the name of a frame."""
        return self._places[number].name

    def files(self, number: int) -> tuple[Path, Path | None]:
        """Return the files of depth and of infrared of a frame."""
        file = self.paths[number]
        return file, infrared_beside(file) if self._infrared is None else self._infrared[number]

    def depth(
        self, number: int, offset_mm: float = 0.0, inside: Path | None = None
    ) -> tuple[Array, float]:
        """Read (H, W) float32 depth, mm, 0 = no depth, and its step, mm, 0 of floats.

        Args:
            number: of the frame.
            offset_mm: added to whole numbers, see ``from_steps``.
            inside: a folder that no link may lead out of.

        Raises:
            DatasetError: also for a PNG file that states another step.
        """
        _, file, place = self._places[number]
        stated_mm = stated_unit_mm(file, inside=inside)
        if stated_mm not in (None, self.step_mm) and not self._unit_wins:
            raise DatasetError(
                f"{file}: states steps of {stated_mm:g} mm, not {self.step_mm:g}: give "
                f"--depth-unit-mm {stated_mm:g}"
            )
        image = read_stored(file, place, inside=inside, channel=self._channel)
        metres = self._in_metres[file.parent]
        depth_mm = depth_in_mm(image, self.step_mm, offset_mm, in_metres=metres)
        return depth_mm, 0.0 if image.dtype.kind == "f" else self.step_mm

    def infrared(self, number: int) -> Array | None:
        """Read (H, W) float32 infrared counts, 0 to 65535; None without. Raises DatasetError."""
        _, file = self.files(number)
        if file is None:
            return None
        image = read_stored(file, self._places[number].number, infrared=True)
        return np.nan_to_num(image.astype(np.float32))

    def _floats_in_metres(self, places: Sequence[FramePlace], unknown: bool) -> bool:
        """Decide by maps of one folder; refuse shifted whole numbers of an unknown step."""
        where = places[0].file if len({place.file for place in places}) == 1 else None
        chosen = np.linspace(0, len(places) - 1, min(len(places), _SAMPLE)).astype(int)
        votes = []
        for _, file, number in (places[k] for k in sorted({*chosen.tolist()})):
            if file.suffix.lower() == ".png" and not unknown:
                continue
            try:
                image = read_stored(file, number, channel=self._channel)
            except DatasetError:  # reported when it is read
                continue
            if unknown and image.dtype.kind == "u":
                refuse_shifted(image, where or file.parent)
                self.notes = (TAKEN_FOR_MM,)
            votes.append(image.ravel()[:: image.size // _SAMPLE_PX + 1].copy())
        return floats_in_metres(votes, where or places[0].file.parent)


def read_map_mm(file: Path, unit_mm: float | None = None) -> Array:
    """Read one depth map, (H, W) float32 millimetres, 0 = no depth. Raises as ``MapFiles``."""
    return MapFiles([FramePlace(file.stem, file)], unit_mm).depth(0)[0]
