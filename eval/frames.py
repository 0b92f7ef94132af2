"""Pairs of clean and noisy frames to score: a data set of glsim, or a folder of PNG files."""

from __future__ import annotations

import zlib
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.config import DEFAULT_SENSOR
from glsim.dataset import Split, open_dataset
from glsim.dataset.images import decode_png
from glsim.dataset.layout import HEADER
from glsim.errors import DatasetError
from glsim.sensor import load_sensor

from .types import Depth

#: A frame whose middle depth is below this is in metres, or in another unit, mm: no depth camera
#: measures nearer.
_NEAREST_MM = 50.0


class Key(NamedTuple):
    """Which frame: subjects are what statistics are made over, sequences have an order in time."""

    subject: str
    sequence: str
    frame: int

    def __str__(self) -> str:
        return f"{self.subject}/{self.sequence}_{self.frame:05d}"


@dataclass(frozen=True, eq=False)
class Sample:
    """(H, W) millimetres, 0 = no depth, and the camera that saw them.

    regions: (H, W) parts of the face as ``Frames.regions`` numbers them, where the set has them.
    """

    clean_mm: Depth
    noisy_mm: Depth
    intrinsics: Intrinsics
    regions: NDArray[np.uint8] | None = None


class Frames(Protocol):
    """Frames by number, those of a sequence next to each other in the order of time."""

    #: Changes whenever the frames may have.
    identity: str
    #: Parts of the face that are labelled: name -> number. Empty where there are none.
    regions: Mapping[str, int]

    def __len__(self) -> int:
        """How many."""
        ...

    def key(self, number: int) -> Key:
        """Which one it is."""
        ...

    def load(self, number: int) -> Sample:
        """Its images. DatasetError for what is missing, damaged or no pair of depth maps."""
        ...


class DatasetFrames:
    """One split of a data set of glsim."""

    def __init__(self, path: Path, split: str) -> None:
        dataset = open_dataset(path)
        self.regions: Mapping[str, int] = dataset.regions
        self._split: Split = dataset.split(split)
        self.identity = f"{zlib.crc32((path / HEADER).read_bytes()):08x} {split}"

    def __len__(self) -> int:
        return len(self._split)

    def key(self, number: int) -> Key:
        """From the manifest."""
        pair = self._split[number]
        return Key(pair.subject, pair.sequence, pair.frame)

    def load(self, number: int) -> Sample:
        """Checked against the manifest."""
        pair = self._split[number]
        sample = checked(pair.clean_mm, pair.noisy_mm, pair.intrinsics, repr(pair))
        return replace(sample, regions=pair.regions.astype(np.uint8)) if self.regions else sample


class FolderFrames:
    """``*_clean.png`` with ``*_noisy.png`` beside it, 16 bits, in millimetres.

    The folder of a file names the subject; a number at the end of its stem the frame. The camera
    is a Kinect V2, or one of ``focal_px`` with its axis through the middle.
    """

    regions: Mapping[str, int] = {}

    def __init__(self, path: Path, focal_px: float | None = None) -> None:
        self._path = path
        self._rig = load_sensor(DEFAULT_SENSOR).rig
        self._focal = None if focal_px is None else (focal_px, focal_px)
        stems = {
            str(file.relative_to(path))[: -len("_clean.png")]
            for layer in ("clean", "noisy")
            for file in path.rglob(f"*_{layer}.png")
        }
        if not stems:
            raise DatasetError(
                f"{path}: is no data set of glsim (it has no {HEADER}), and holds no pairs of "
                "*_clean.png and *_noisy.png"
            )
        self._stems = sorted(stems, key=lambda stem: (_key(stem), stem))
        listing = [(stem, *map(_size, self._files(stem))) for stem in self._stems]
        self.identity = f"{zlib.crc32(repr(listing).encode()):08x} {self._focal}"

    def __len__(self) -> int:
        return len(self._stems)

    def key(self, number: int) -> Key:
        """From the path."""
        return _key(self._stems[number])

    def load(self, number: int) -> Sample:
        """Both files."""
        clean_file, noisy_file = self._files(self._stems[number])
        clean, noisy = _read(clean_file, "clean"), _read(noisy_file, "noisy")
        rig = self._rig.for_map((clean.shape[0], clean.shape[1]), self._focal)
        return checked(clean, noisy, rig.intrinsics, str(self._path / self._stems[number]))

    def _files(self, stem: str) -> tuple[Path, Path]:
        return self._path / f"{stem}_clean.png", self._path / f"{stem}_noisy.png"


def _size(file: Path) -> tuple[int, int]:
    try:
        status = file.stat()
    except OSError:
        return 0, 0
    return status.st_size, status.st_mtime_ns


def _key(stem: str) -> Key:
    path = Path(stem)
    name = path.name.rstrip("0123456789")
    digits = path.name[len(name) :]
    subject = path.parent.as_posix()
    return Key(subject if subject != "." else "all", name.rstrip("_"), int(digits or 0))


def _read(path: Path, layer: str) -> Depth:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise DatasetError(f"{path}: is missing") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    depth: Depth = decode_png(data, layer, str(path)).astype(np.float32)
    return depth


def checked(clean: Depth, noisy: Depth, intrinsics: Intrinsics, where: str) -> Sample:
    """A pair, or DatasetError: sizes differ, or the depths cannot be millimetres."""
    if clean.shape != noisy.shape:
        raise DatasetError(
            f"{where}: clean is {clean.shape[1]} x {clean.shape[0]} pixels, noisy "
            f"{noisy.shape[1]} x {noisy.shape[0]}"
        )
    for layer, depth in (("clean", clean), ("noisy", noisy)):
        check_millimetres(depth, f"{where} ({layer})")
    return Sample(clean, noisy, intrinsics)


def check_millimetres(depth: Depth, where: str) -> None:
    """DatasetError where half of the depths are nearer than any camera measures: metres, mostly."""
    found = depth[depth > 0]
    if found.size and (middle := float(np.median(found))) < _NEAREST_MM:
        raise DatasetError(
            f"{where}: its middle depth is {middle:g} mm: is it in metres instead of millimetres?"
        )


def open_frames(path: Path, split: str, focal_px: float | None = None) -> Frames:
    """A data set's split, or the pairs of a folder, of its sub-folder ``split`` if it has one.

    Raises DatasetError.
    """
    if not path.is_dir():
        raise DatasetError(f"{path}: no such folder")
    if (path / HEADER).exists() or (path / ".glsim").exists():
        return DatasetFrames(path, split)
    part = path / split
    return FolderFrames(part if part.is_dir() else path, focal_px)


class Stacks:
    """Frames with their neighbours in time, each read once for frames asked for in order."""

    def __init__(self, frames: Frames, before: int, after: int) -> None:
        self._frames, self._before, self._after = frames, before, after
        self._cache: OrderedDict[int, Sample | DatasetError] = OrderedDict()

    def sample(self, number: int) -> Sample:
        """One frame. Raises DatasetError."""
        if number not in self._cache:
            try:
                self._cache[number] = self._frames.load(number)
            except DatasetError as error:
                self._cache[number] = error
            while len(self._cache) > self._before + self._after + 1:
                self._cache.popitem(last=False)
        found = self._cache[number]
        if isinstance(found, DatasetError):
            raise found
        return found

    def around(self, number: int, before: int, after: int) -> tuple[Depth, int]:
        """(T, H, W) noisy frames around one, and its place among them.

        Neighbours are of the same sequence and size; those that cannot be read are left out.
        """
        sample = self.sample(number)
        key = self._frames.key(number)
        stack: list[Depth] = []
        now = 0
        first, last = max(0, number - before), min(len(self._frames) - 1, number + after)
        for other in range(first, last + 1):
            if other == number:
                now = len(stack)
                stack.append(sample.noisy_mm)
            elif self._frames.key(other)[:2] == key[:2]:
                try:
                    neighbour = self.sample(other).noisy_mm
                except DatasetError:
                    continue
                if neighbour.shape == sample.noisy_mm.shape:
                    stack.append(neighbour)
        return np.stack(stack), now
