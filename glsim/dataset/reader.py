"""Read a data set, PNG tree or shards: records, and depth maps in millimetres.

Nothing is believed because it is written there: the header and each record pass their schema
(``glsim.dataset.schema``), the manifest has the checksum that the header holds, the header the one
in ``.glsim``, and every file that a record names is a regular file inside the data set.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from glsim.dataset.cloud_mirror import fetch_images, mirror
from glsim.dataset.disk_format import HEADER, MANIFEST
from glsim.dataset.header import header_problem, manifest_problem, read_header
from glsim.dataset.layer_images import LayerImage, decode_layer
from glsim.dataset.manifest import REPAIR, Manifest
from glsim.depth_protocol import DepthProtocol, stored_protocol
from glsim.errors import DatasetError, did_you_mean
from glsim.files.atomic import checksum, wrap_read_errors
from glsim.files.cloud import CloudFolder, cloud_url
from glsim.files.png import MAX_IMAGE_BYTES
from glsim.files.regular import open_regular, read_regular
from glsim.frame import WRITABLE, to_mm
from glsim.geometry.camera import Intrinsics
from glsim.geometry.normal_codes import decode_normals
from glsim.reason import Reason
from glsim.settings.schema import SPLIT_NAMES

log = logging.getLogger(__name__)


class Pair:
    """One frame of a data set. Images are read and checked when they are first used.

    record: its record in the manifest, see ``glsim.dataset.records.frame_record``.
    """

    def __init__(
        self,
        root: Path | CloudFolder,
        record: Mapping[str, Any],
        depth_unit_mm: float,
    ) -> None:
        self.record = record
        self._root = root
        self._unit_mm = depth_unit_mm
        self._fetched: dict[str, bytes] = {}  # layer -> bytes, of a data set in object storage

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
        """The name of the sequence."""
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
        """The millimetres that were subtracted from stored depths (0 unless normalised)."""
        return float(self.record["depth_offset_mm"])

    @property
    def has_clean(self) -> bool:
        """Whether the true depth is known; it is not in recordings of a real camera."""
        return "clean" in self.record["files"]

    @cached_property
    def clean_mm(self) -> NDArray[np.float32]:
        """(H, W) float32 true depth, millimetres from the camera, 0 = no surface.

        Raises DatasetError in a data set without clean maps, see ``has_clean``.
        """
        return self._depth_mm("clean")

    @cached_property
    def expected_mm(self) -> NDArray[np.float32]:
        """(H, W) float32 true depth with the sensor's systematic error, millimetres, 0 = none.

        Raises DatasetError in a data set that was generated without the layer.
        """
        return self._depth_mm("expected")

    @cached_property
    def noisy_mm(self) -> NDArray[np.float32]:
        """(H, W) float32 measured depth, millimetres from the camera, 0 = no return."""
        return self._depth_mm("noisy")

    @cached_property
    def infrared(self) -> LayerImage:
        """(H, W) uint16 infrared counts."""
        return self.image("infrared")

    @cached_property
    def reason(self) -> LayerImage:
        """(H, W) uint8 codes of ``glsim.reason.Reason``."""
        return self.image("reason")

    @cached_property
    def regions(self) -> LayerImage:
        """(H, W) uint8 parts of the face, with the numbers of ``Dataset.regions``; 0 = none."""
        return self.image("regions")

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """(H, W, 3) float32 unit normals of the true surface, camera frame; 0 without a surface.

        Raises DatasetError in a data set that was generated without the layer.
        """
        return decode_normals(np.asarray(self.image("normals"), np.uint16))

    def image(self, layer: str) -> LayerImage:
        """Read a layer as stored: (H, W) uint16, or uint8 for "reason" and "regions".

        "normals" is (H, W, 3) uint16, see ``normals``.

        Raises DatasetError if the data set has no such layer, or if the file is missing, was
        changed, or is no image of the right type and size.
        """
        files = self.record["files"]
        if layer not in files:
            if layer == "clean":
                raise DatasetError(no_clean(self._root))
            if layer == "expected":
                raise DatasetError(no_expected(self._root))
            raise DatasetError(
                f"{self._root}: has no layer {layer!r} ({did_you_mean(layer, files)})"
            )
        file = files[layer]
        where = f"{self._root}/{file['name']}"
        if "member" in file:
            where += f" ({file['member']})"
        data = self._read(layer)
        image = decode_layer(data, layer, where)
        if checksum(data) != {"size": file["size"], "crc32": file["crc32"]}:
            raise DatasetError(
                f"{where}: was changed after it was written ({len(data)} bytes, {file['size']} "
                f"recorded): {REPAIR}"
            )
        size = (self.record["intrinsics"]["height"], self.record["intrinsics"]["width"])
        if image.shape[:2] != size:
            raise DatasetError(
                f"{where}: is {image.shape[1]} x {image.shape[0]} pixels, the record says "
                f"{size[1]} x {size[0]}"
            )
        if layer == "reason" and image.max(initial=0) > max(Reason):
            raise DatasetError(f"{where}: holds {image.max()}, which is no code of a reason")
        return image

    def fetch(self) -> None:
        """Read the bytes of all layers from object storage, if the data set lies there."""
        if isinstance(self._root, CloudFolder) and not self._fetched:
            self._fetched = fetch_images(self._root, self.record["files"])

    def _read(self, layer: str) -> bytes:
        """Read a whole file or a member of a shard; a truncated member is returned truncated."""
        if isinstance(self._root, CloudFolder):
            self.fetch()
            return self._fetched[layer]
        return _read(self._root, self.record["files"][layer])

    def _depth_mm(self, layer: str) -> NDArray[np.float32]:
        return to_mm(self.image(layer), self._unit_mm, self.depth_offset_mm)


def _read(root: Path, file: Mapping[str, Any]) -> bytes:
    """Read a whole file or a member of a shard; a truncated member is returned truncated."""
    path = root / file["name"]
    with wrap_read_errors(path):
        if "offset" not in file:
            return read_regular(path, MAX_IMAGE_BYTES, inside=root)
        with open_regular(path, inside=root) as stream:
            stream.seek(file["offset"])
            return stream.read(int(file["size"]))


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

    header: the contents of dataset.json. path: its folder; of one in object storage, the folder
    with the copies of its header and manifest, see ``glsim.dataset.cloud_mirror``. Opening reads
    the manifest once for its checksum. Raises
    DatasetError if the folder holds no complete data set, one of a newer version of glsim, or one
    whose header or manifest is damaged or was changed.
    """

    def __init__(self, path: Path | str) -> None:
        url = cloud_url(path)
        self._images: Path | CloudFolder = Path(path) if url is None else CloudFolder(url)
        self.path = self._images if isinstance(self._images, Path) else mirror(self._images)
        self.header = read_header(self.path)
        self.depth_unit_mm = float(self.header["depth_unit_mm"])
        if problem := header_problem(self.path):
            raise DatasetError(f"{self.path / HEADER}: {problem}: {REPAIR}")
        self._manifest = Manifest(self.path)
        if problem := manifest_problem(self.header, self._manifest):
            raise DatasetError(f"{self._manifest.path}: {problem}: {REPAIR}")
        if MANIFEST not in self.header["files"]:
            log.warning("%s: has no checksum in %s: changes are not noticed", MANIFEST, HEADER)

    def __str__(self) -> str:
        return str(self._images)

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
        if isinstance(self._images, CloudFolder):
            size = self._images.size(name)
            if size is None:
                raise DatasetError(f"{self._images.where(name)}: is missing: {REPAIR}")
            return size
        path = self._images / name
        with wrap_read_errors(path), open_regular(path, inside=self._images) as file:
            return os.fstat(file.fileno()).st_size

    @property
    def is_remote(self) -> bool:
        """Whether the images lie in object storage: each read takes a request over the network."""
        return isinstance(self._images, CloudFolder)

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
        return Pair(self._images, record, self.depth_unit_mm)


def no_clean(path: object) -> str:
    """Return the error message for a data set without clean maps."""
    return (
        f"{path}: has no layer 'clean', the true depth that this needs: generate a data set with "
        "--layers clean,noisy (recordings of a real camera have none: glsim compare and glsim "
        "denoise take them)"
    )


def no_expected(path: object) -> str:
    """Return the error message for a data set without maps of the expected depth."""
    return (
        f"{path}: has no layer 'expected', the true depth with the sensor's systematic error: "
        "generate a data set with --layers clean,expected,noisy"
    )


def open_dataset(path: Path | str) -> Dataset:
    """Open a complete data set: a folder, or a URL of object storage such as s3://bucket/faces.

    Raises DatasetError as ``Dataset`` does.
    """
    return Dataset(path)
