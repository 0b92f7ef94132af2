"""Reading a data set back: records, and depth maps in millimetres. PNG trees and shards alike."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.config import SPLIT_NAMES
from glsim.dataset.files import check_bytes, read_json, reading
from glsim.dataset.images import Image, decode_png
from glsim.dataset.layout import FORMAT, FORMAT_VERSION, HEADER, MANIFEST, STATE
from glsim.errors import DatasetError, did_you_mean
from glsim.frame import WRITABLE, to_mm

_BLOCK = 1 << 24


class Pair:
    """One frame of a data set. Images are read and checked when they are first asked for.

    record: the manifest's record, see ``glsim.dataset.record.frame_record``.
    """

    def __init__(self, root: Path, record: Mapping[str, Any], depth_unit_mm: float) -> None:
        self.record = record
        self._root = root
        self._unit_mm = depth_unit_mm

    def __repr__(self) -> str:
        return f"Pair({self.split}/{self.subject}/{self.sequence}_{self.frame:05d})"

    @property
    def index(self) -> int:
        """Position in the plan of the data set."""
        return int(self.record["index"])

    @property
    def split(self) -> str:
        """train, val or test."""
        return str(self.record["split"])

    @property
    def subject(self) -> str:
        """The person's name in the data set."""
        return str(self.record["subject"])

    @property
    def sequence(self) -> str:
        """The recording's name."""
        return str(self.record["sequence"])

    @property
    def frame(self) -> int:
        """Number within the sequence."""
        return int(self.record["frame"])

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera of the delivered image."""
        return Intrinsics(**self.record["intrinsics"])

    @property
    def depth_offset_mm(self) -> float:
        """What the files' depths lack (0 unless the data set is normalised)."""
        return float(self.record["depth_offset_mm"])

    @cached_property
    def clean_mm(self) -> NDArray[np.float32]:
        """(H, W) float32 true depth, millimetres from the camera, 0 = no surface."""
        return self._depth_mm("clean")

    @cached_property
    def noisy_mm(self) -> NDArray[np.float32]:
        """(H, W) float32 measured depth, millimetres from the camera, 0 = no return."""
        return self._depth_mm("noisy")

    @cached_property
    def infrared(self) -> Image:
        """(H, W) uint16 infrared counts."""
        return self.image("infrared")

    @cached_property
    def reason(self) -> Image:
        """(H, W) uint8 codes of ``glsim.reason.Reason``."""
        return self.image("reason")

    @cached_property
    def regions(self) -> Image:
        """(H, W) uint8 parts of the face, numbered as ``Dataset.regions`` says; 0 = none."""
        return self.image("regions")

    def image(self, layer: str) -> Image:
        """(H, W) the layer as it is in its file: uint16, or uint8 for "reason" and "regions".

        Raises DatasetError if the data set has no such layer, or if the file is missing, is not
        what was written, or is no image of the right type and size.
        """
        files = self.record["files"]
        if layer not in files:
            raise DatasetError(
                f"{self._root}: has no layer {layer!r} ({did_you_mean(layer, files)})"
            )
        file = files[layer]
        path = self._root / file["name"]
        where = f"{path} ({file['member']})" if "member" in file else str(path)
        data = _read(path, file)
        image = decode_png(data, layer, where)
        if check_bytes(data) != {"size": file["size"], "crc32": file["crc32"]}:
            raise DatasetError(
                f"{where}: was changed after it was written ({len(data)} bytes, {file['size']} "
                "recorded): run glsim generate again with the same settings to repair it"
            )
        size = (self.record["intrinsics"]["height"], self.record["intrinsics"]["width"])
        if image.shape != size:
            raise DatasetError(
                f"{where}: is {image.shape[1]} x {image.shape[0]} pixels, the record says "
                f"{size[1]} x {size[0]}"
            )
        return image

    def _depth_mm(self, layer: str) -> NDArray[np.float32]:
        return to_mm(self.image(layer), self._unit_mm, self.depth_offset_mm)


def _read(path: Path, file: Mapping[str, Any]) -> bytes:
    """A whole file, or the part of a shard. A part that is cut short is returned as it is."""
    with reading(path), path.open("rb") as stream:
        if "offset" not in file:
            return stream.read()
        stream.seek(file["offset"])
        content: bytes = stream.read(file["size"])
    return content


class Split(Sequence[Pair]):
    """The frames of one split, in the order of the manifest: iterate, or take one by number."""

    def __init__(self, dataset: Dataset, name: str, first: int, count: int) -> None:
        self.name = name
        self._dataset = dataset
        self._first = first
        self._count = count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, number: int) -> Pair: ...
    @overload
    def __getitem__(self, number: slice) -> list[Pair]: ...
    def __getitem__(self, number: int | slice) -> Pair | list[Pair]:
        """The frame at a position in the split, from 0; from the end if negative."""
        if isinstance(number, slice):
            return [self[position] for position in range(*number.indices(self._count))]
        position = number + self._count if number < 0 else number
        if not 0 <= position < self._count:
            raise IndexError(f"{self.name} has {self._count} frames, not one at {number}")
        return self._dataset.pair(self._first + position)

    def __iter__(self) -> Iterator[Pair]:
        return self._dataset.pairs(self._first, self._count)


class Dataset:
    """A complete data set on disk. Cheap to open, and to send to other processes.

    header: dataset.json. Raises DatasetError for a folder that is no complete data set, or one of
    a newer version of glsim.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.header = read_header(self.path)
        self.depth_unit_mm = float(self.header["depth_unit_mm"])
        self._ends: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return sum(self.header["frames"].values())

    def __iter__(self) -> Iterator[Pair]:
        return self.pairs(0, len(self))

    def split(self, name: str) -> Split:
        """The frames of train, val or test; empty if the data set has none there."""
        if name not in SPLIT_NAMES:
            raise DatasetError(f"no such split {name!r}: {did_you_mean(name, SPLIT_NAMES)}")
        counts = self.header["frames"]
        before = SPLIT_NAMES[: SPLIT_NAMES.index(name)]
        return Split(self, name, sum(counts[split] for split in before), counts[name])

    @property
    def layers(self) -> tuple[str, ...]:
        """The layers that each frame has."""
        written = self.header["settings"]["output"]["layers"]
        return tuple(layer for layer in WRITABLE if layer in written)

    @property
    def regions(self) -> dict[str, int]:
        """Parts of the face by name -> their numbers in the layer regions; empty without it."""
        return dict(self.header.get("regions", {}))

    @property
    def is_tree(self) -> bool:
        """Whether each image is a file of its own, rather than part of a shard."""
        return bool(self.header["settings"]["output"]["format"] == "png")

    def pair(self, number: int) -> Pair:
        """The frame in line ``number`` of the manifest, from 0."""
        ends = self._line_ends()
        start = int(ends[number - 1]) if number else 0
        with self._manifest().open("rb") as lines:
            lines.seek(start)
            return self._parse(lines.read(int(ends[number]) - start), number)

    def pairs(self, first: int, count: int) -> Iterator[Pair]:
        """The frames of consecutive lines of the manifest, read as they are needed."""
        start = int(self._line_ends()[first - 1]) if first and count else 0
        with self._manifest().open("rb") as lines:
            lines.seek(start)
            for number in range(first, first + count):
                yield self._parse(lines.readline(), number)

    def _manifest(self) -> Path:
        path = self.path / MANIFEST
        if not path.exists():
            raise DatasetError(f"{path}: is missing: run glsim generate again to restore it")
        return path

    def _parse(self, line: bytes, number: int) -> Pair:
        try:
            return Pair(self.path, json.loads(line), self.depth_unit_mm)
        except ValueError:
            raise DatasetError(
                f"{self.path / MANIFEST}: line {number + 1} is damaged: run glsim generate again "
                "with the same settings to repair it"
            ) from None

    def _line_ends(self) -> NDArray[np.int64]:
        """Where each line of the manifest ends, bytes. DatasetError if the count is wrong."""
        if self._ends is None:
            parts: list[NDArray[np.int64]] = []
            start = 0
            with self._manifest().open("rb") as lines:
                while block := lines.read(_BLOCK):
                    parts.append(np.flatnonzero(np.frombuffer(block, np.uint8) == 10) + start + 1)
                    start += len(block)
            ends = np.concatenate(parts) if parts else np.zeros(0, np.int64)
            if len(ends) != len(self):
                raise DatasetError(
                    f"{self.path / MANIFEST}: has {len(ends)} lines, {HEADER} says {len(self)}: "
                    "run glsim generate again with the same settings to repair it"
                )
            self._ends = ends
        return self._ends


def open_dataset(path: Path | str) -> Dataset:
    """Open a complete data set. Raises DatasetError, see Dataset."""
    return Dataset(path)


def read_header(path: Path) -> dict[str, Any]:
    """dataset.json, checked to be one that this version can read. DatasetError otherwise."""
    file = path / HEADER
    if not file.exists():
        if (path / STATE).is_dir():
            raise DatasetError(
                f"{path}: is not complete: run glsim generate again with the same settings"
            )
        raise DatasetError(f"{path}: is no data set of glsim: it has no {HEADER}")
    header = read_json(file)
    if header.get("format") != FORMAT:
        raise DatasetError(f"{file}: is not the header of a glsim data set")
    if header.get("format_version", 0) > FORMAT_VERSION:
        raise DatasetError(
            f"{file}: format version {header['format_version']} is newer than {FORMAT_VERSION}, "
            "which this glsim reads: update glsim"
        )
    missing = [key for key in ("frames", "depth_unit_mm", "settings", "files") if key not in header]
    if missing:
        raise DatasetError(f"{file}: is damaged: it lacks {', '.join(missing)}")
    return header
