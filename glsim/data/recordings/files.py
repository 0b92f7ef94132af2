"""Depth maps in single files: their unit is decided once, then maps are read one by one.

16-bit integers are steps of a unit. Floats are metres, or millimetres as libfreenect2 writes them;
the median of a folder decides. At most 16 maps of a set are decoded for these decisions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.png import LAYER_KEYWORD, stated_text, stated_unit_mm
from glsim.data.map_files import (
    along_ray,
    depth_in_mm,
    doubt_of_floats,
    doubt_of_steps,
    floats_in_metres,
    read_stored,
    refuse_negative,
    refuse_other_unit,
)
from glsim.data.recordings.names import DEPTH_LAYERS, infrared_beside

#: Largest number of maps of a set that vote on its unit, largest number of these that are kept to
#: recognise the camera, and number of values per map that decide on a unit. Chosen, not measured.
VOTERS, SHOWN, _VALUES = 16, 4, 20_000
#: Number of maps of another size that a note names. Chosen.
_NAMED = 3


class FramePlace(NamedTuple):
    """Name and files of one depth map.

    Attributes:
        file: PNG, TIFF, OpenEXR, ``.npy``, dump of libfreenect2, or Biwi's depth.bin.
        number: number of the map in a stack; None if the file has one map.
        infrared: file of the infrared image, if it is not beside ``file``.
        offset_mm: depth that is added to integers, see ``from_steps``.
    """

    name: str
    file: Path
    number: int | None = None
    inside: Path | None = None
    infrared: Path | None = None
    offset_mm: float = 0.0


class Votes(NamedTuple):
    """Facts about the sampled maps of a set, at most 16.

    Attributes:
        maps_mm: up to four of the maps, (H, W) float32 mm, 0 = no depth.
        step_mm: step of integers, mm; 0 for floats.
    """

    maps_mm: tuple[Floats, ...] = ()
    step_mm: float = 1.0
    deepest_mm: float = 0.0


class MapFiles:
    """A reader of depth maps and infrared images in files.

    Attributes:
        step_mm: step of integers; the largest step if each PNG file states its own.
        layers: layers that sampled PNG files of glsim state; "" for one that states none.
        ray_channel: OpenEXR channel with distances along rays; "" if the files have depths.
    """

    def __init__(
        self, places: Sequence[FramePlace], given_mm: float | None = None,
        stated_mm: float | None = None, channel: str | None = None, folder: Path | None = None,
    ) -> None:  # fmt: skip
        """Decide the step of integers, and for each folder the unit of floats.

        Args:
            given_mm: step of integers from an option. Default: the stated step, else 1.
            stated_mm: step that a camera.toml or a data set states, above the PNG files' steps.
            folder: the folder that was searched for the files, for messages.

        Raises:
            ConfigError: two different steps are stated or given.
            DatasetError: integers are shifted, floats are neither metres nor millimetres, or none
                of the sampled maps can be read.
        """
        self.places, self._channel, self._folder = tuple(places), channel or None, folder
        self.notes: tuple[str, ...] = ()
        folders: dict[Path, list[FramePlace]] = {}
        for place in self.places:
            folders.setdefault(place.file.parent, []).append(place)
        voters = _voters([*folders.values()])
        self.layers = {stated_text(place.file, LAYER_KEYWORD) for place in voters}
        named = {stated_unit_mm(place.file, inside=place.inside) for place in voters}
        #: Whether each PNG file has its own step: no camera.toml and no data set states one.
        self._each_states = stated_mm is None and named != {None}
        if self._each_states:
            if None in named and named != {None, 1.0}:
                raise ConfigError(
                    "some of the maps state steps other than 1 mm and some state none: take those "
                    "of one kind at a time"
                )
            steps = {step or 1.0 for step in named}
            stated_mm = max(steps - {given_mm}, default=given_mm)
        step_mm = agreed_unit_mm(given_mm, stated_mm, self.places[0].file)
        self.step_mm = step_mm or 1.0
        images = self._read(voters)
        self._in_metres: Mapping[Path, bool] = {
            folder: self._decide(folder, images, unknown=step_mm is None) for folder in folders
        }
        if not all(self._in_metres.values()):
            floats = "floats are taken for mm: their median is too large for metres"
            self.notes = (*self.notes, floats)
        exr = next((p.file for p in voters if p.file.suffix.lower() == ".exr"), None)
        self.ray_channel = "" if exr is None else along_ray(exr, self._channel)
        shape = images[next(iter(images))].shape
        if other := [place.name for place, image in images.items() if image.shape != shape]:
            sizes = f"{len(other)} of {len(images)} sampled maps have another size than the first"
            self.notes = (*self.notes, f"{sizes}: {', '.join(other[:_NAMED])}")
        maps = [self._in_mm(place, image) for place, image in images.items()]
        deepest_mm = max(float(depth_mm.max(initial=0)) for depth_mm, _ in maps)
        self.votes = Votes(tuple(shown for shown, _ in maps[:SHOWN]), maps[0][1], deepest_mm)

    def __len__(self) -> int:
        return len(self.places)

    def name(self, number: int) -> str:
        """Return the name of a frame."""
        return self.places[number].name

    def files(self, number: int) -> tuple[Path, Path | None]:
        """Return the files of depth and of infrared of a frame."""
        place = self.places[number]
        return place.file, place.infrared or infrared_beside(place.file)

    def has_infrared_of(self, number: int) -> bool:
        """Whether there is an infrared image of a frame."""
        return self.files(number)[1] is not None

    def depth(self, number: int) -> tuple[Floats, float]:
        """Read (H, W) float32 depth in mm, 0 = no depth; and its step in mm, 0 for floats.

        Raises DatasetError.
        """
        place = self.places[number]
        return self._in_mm(place, self._stored(place))

    def infrared(self, number: int) -> Floats | None:
        """Read (H, W) float32 infrared, 0 to 65535 counts, or None. Raises DatasetError."""
        _, file = self.files(number)
        if file is None:
            return None
        image = read_stored(file, self.places[number].number, infrared=True)
        return np.nan_to_num(image.astype(np.float32))

    def _stored(self, place: FramePlace) -> NDArray[np.generic]:
        layer = stated_text(place.file, LAYER_KEYWORD)
        if layer not in ("", *DEPTH_LAYERS):
            raise DatasetError(
                f"{place.file}: is the layer {layer} of a frame of glsim, not its depth: give the "
                "layer noisy, or clean"
            )
        return read_stored(place.file, place.number, inside=place.inside, channel=self._channel)

    def _in_mm(self, place: FramePlace, image: NDArray[np.generic]) -> tuple[Floats, float]:
        metres, step_mm = self._in_metres[place.file.parent], self.step_mm
        if self._each_states:
            step_mm = stated_unit_mm(place.file, inside=place.inside) or 1.0
        depth_mm = depth_in_mm(image, step_mm, place.offset_mm, in_metres=metres)
        if image.dtype.kind == "f":
            refuse_other_unit(image, depth_mm, place.file)
        return depth_mm, 0.0 if image.dtype.kind == "f" else step_mm

    def _read(self, voters: Sequence[FramePlace]) -> dict[FramePlace, NDArray[np.generic]]:
        """Read the sampled maps; raise the first error if no map can be read."""
        images: dict[FramePlace, NDArray[np.generic]] = {}
        first: DatasetError | None = None
        for place in voters:
            try:
                images[place] = self._stored(place)
            except DatasetError as error:  # one of many maps; reading it reports the error
                first = first or error
        if first is not None and not images:
            raise DatasetError(f"{self._folder}: no depth map: {first}") if self._folder else first
        return images

    def _decide(
        self, folder: Path, images: Mapping[FramePlace, NDArray[np.generic]], unknown: bool
    ) -> bool:
        """Return whether a folder's floats are metres; refuse shifted integers of unknown step."""
        own = {place: image for place, image in images.items() if place.file.parent == folder}
        files = {place.file for place in own}
        where = files.pop() if len(files) == 1 else folder
        for image in own.values():
            refuse_negative(image, where)
            steps = unknown and image.dtype.kind == "u"
            if doubt := doubt_of_steps(image, where) if steps else doubt_of_floats(image):
                self.notes = (doubt,)
        thinned = [image.ravel()[:: image.size // _VALUES + 1] for image in own.values()]
        return floats_in_metres(thinned, where)


def _voters(folders: Sequence[Sequence[FramePlace]]) -> list[FramePlace]:
    """Return the maps to sample: 16 evenly spread maps, and one of each folder of floats."""
    share = max(1, VOTERS // len(folders))
    voters = [places[k] for places in folders for k in spread(len(places), share)]
    whole = [place for place in voters if place.file.suffix.lower() == ".png"]
    floats = [place for place in voters if place.file.suffix.lower() != ".png"]
    return [*(whole[k] for k in spread(len(whole), VOTERS)), *floats]


def spread(count: int, most: int) -> list[int]:
    """Return at most ``most`` evenly spread numbers from 0 to ``count`` - 1."""
    return [int(number) for number in np.linspace(0, count - 1, min(count, most)).round()]


def agreed_unit_mm(given: float | None, stated: float | None, where: object) -> float | None:
    """Return the step of integers, mm, from an option or from files.

    Raises ConfigError if the two differ, and for a step of 0 or less.
    """
    if given is not None and not given > 0:
        raise ConfigError(f"--depth-unit-mm {given:g}: must be above 0")
    if given is not None and stated is not None and given != stated:
        raise ConfigError(
            f"--depth-unit-mm {given:g}: {where} states steps of {stated:g} mm: leave the option "
            "out, or correct what states them"
        )
    return stated or given


def read_map_mm(file: Path, unit_mm: float | None = None) -> Floats:
    """Read a map: (H, W) float32 mm, 0 = no depth. Raises the errors of ``MapFiles``."""
    return MapFiles([FramePlace(file.stem, file)], unit_mm).depth(0)[0]
