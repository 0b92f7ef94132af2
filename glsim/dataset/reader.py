"""Read a data set, PNG tree or shards: records, and depth maps in millimetres.

Everything is checked: the header and each record against ``glsim.dataset.record_schema``, the
manifest against its checksum in the header, the header against its checksum in ``.glsim``; and
every file that a record names must be a regular file inside the data set.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

from glsim.dataset.disk_format import HEADER, MANIFEST
from glsim.dataset.header import manifest_problem, open_header
from glsim.dataset.manifest import REPAIR
from glsim.dataset.pair import Pair
from glsim.depth_protocol import DepthProtocol, stored_protocol
from glsim.errors import DatasetError, did_you_mean
from glsim.files.store import open_store
from glsim.frame import WRITABLE
from glsim.settings.schema import SPLIT_NAMES

log = logging.getLogger(__name__)


class Split(Sequence[Pair]):
    """The frames of one split in the order of the manifest: a sequence of Pairs."""

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
        """Return the frame at a position in the split, from 0; from the end if negative."""
        if isinstance(number, slice):
            return [self[position] for position in range(*number.indices(self._count))]
        position = number + self._count if number < 0 else number
        if not 0 <= position < self._count:
            raise IndexError(f"{self.name} has {self._count} frames, not one at {number}")
        return self._dataset.pair(self._first + position)

    def __iter__(self) -> Iterator[Pair]:
        return self._dataset.pairs(self._first, self._count)


class Dataset:
    """A complete data set on disk or in object storage. It is cheap to send to other processes.

    Opening reads the manifest once for its checksum.
    Raises DatasetError if the folder holds no complete data set, one of a newer version of glsim,
    or one whose header or manifest is damaged or was changed.

    Attributes:
        header: the contents of dataset.json.
        path: its folder; of one in object storage, a folder with copies of its header and manifest
            in the cache of glsim ($GLSIM_CACHE, else ~/.cache/glsim).
    """

    def __init__(self, path: Path | str) -> None:
        self._store = open_store(path)
        self.header, problem, self._manifest = open_header(self._store)
        self.depth_unit_mm = float(self.header["depth_unit_mm"])
        if problem:
            raise DatasetError(f"{self._store.where(HEADER)}: {problem}: {REPAIR}")
        if problem := manifest_problem(self.header, self._manifest):
            raise DatasetError(f"{self._store.where(MANIFEST)}: {problem}: {REPAIR}")
        self.path = self._manifest.path.parent
        if MANIFEST not in self.header["files"]:
            log.warning("%s: has no checksum in %s: changes are not noticed", MANIFEST, HEADER)

    def __str__(self) -> str:
        return str(self._store)

    def __len__(self) -> int:
        return sum(self.header["frames"].values())

    def __iter__(self) -> Iterator[Pair]:
        return self.pairs(0, len(self))

    def split(self, name: str) -> Split:
        """Return the frames (maybe none) of a split. Raises DatasetError for an unknown split."""
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
    def protocol(self) -> DepthProtocol:
        """What the files hold: depth as measured, or moved to 1 mm ("paper").

        The maps of a ``Pair`` in millimetres are as measured either way.
        """
        return stored_protocol(self.header["settings"]["output"].get("nearest_to_mm"))

    @property
    def regions(self) -> dict[str, int]:
        """Name -> number of the parts of the face; empty without the layer "regions"."""
        return dict(self.header.get("regions", {}))

    @property
    def sensor_title(self) -> str:
        """The sensor's description in one line; its name if it has none."""
        sensor = self.header.get("sensor", {})
        return str(sensor.get("title", sensor.get("name", "unknown sensor")))

    def file_size(self, name: str) -> int:
        """Return the size of a file of the data set, bytes. Raises DatasetError if it is none."""
        size = self._store.size(name)
        if size is None:
            raise DatasetError(f"{self._store.where(name)}: is missing: {REPAIR}")
        return size

    @property
    def is_remote(self) -> bool:
        """Whether the images lie in object storage: each read takes a request over the network."""
        return self._store.is_remote

    @property
    def is_tree(self) -> bool:
        """Whether each image is its own file rather than a member of a shard."""
        return bool(self.header["settings"]["output"]["format"] == "png")

    def pair(self, number: int) -> Pair:
        """Return the frame in line ``number`` of the manifest, from 0."""
        return self._pair(self._manifest.record(number), number)

    def pairs(self, first: int, count: int) -> Iterator[Pair]:
        """Yield the frames of consecutive lines of the manifest, each read when it is needed."""
        lines = enumerate(self._manifest.lines(first, count), start=first)
        return (self._pair(self._manifest.parse(line, number), number) for number, line in lines)

    def _pair(self, record: Mapping[str, Any], number: int) -> Pair:
        """Make the pair of a line; its split must be the one that the header counts it to."""
        counts = self.header["frames"]
        end = 0
        for expected in SPLIT_NAMES:
            end += counts[expected]
            if number < end:
                break
        if record["split"] != expected:
            raise self._manifest.damage(
                number, f"split: is {record['split']}, {HEADER} counts this frame to {expected}"
            )
        for layer in self.header["settings"]["output"]["layers"]:
            if layer not in record["files"]:
                raise self._manifest.damage(number, f"files: it lacks the layer {layer!r}")
        return Pair(self._store, record, self.depth_unit_mm)


def open_dataset(path: Path | str) -> Dataset:
    """Open a complete data set: a folder, or a URL of object storage such as s3://bucket/faces.

    Raises DatasetError as ``Dataset`` does.
    """
    return Dataset(path)
