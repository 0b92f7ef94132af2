"""One frame of a data set: its record, and its images when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.dataset.layer_images import LayerImage, decode_layer
from glsim.dataset.manifest import REPAIR
from glsim.errors import DatasetError, did_you_mean
from glsim.files.atomic import checksum, missing
from glsim.files.png import MAX_IMAGE_BYTES
from glsim.files.store import Store
from glsim.frame import to_mm
from glsim.geometry.camera import Intrinsics
from glsim.geometry.normal_codes import decode_normals
from glsim.reason import Reason

#: Bytes between two members of a shard: a header and the rest of the last block, 512 each.
_TAR_BYTES = 1024


#: Layer -> the key and attribute of its array.
_ARRAYS = {"clean": "clean_mm", "expected": "expected_mm", "noisy": "noisy_mm"}
#: What identifies a frame.
_NAMES = ("index", "subject", "sequence", "frame")


class Pair(Mapping[str, Any]):
    """One frame of a data set. Images are read and checked when they are first used.

    It is also a mapping of its layers (clean_mm, noisy_mm, infrared, ...) and of index, subject,
    sequence and frame, so that a DataLoader of PyTorch makes batches of a split as it stands.

    Args:
        record: its record in the manifest, see ``glsim.dataset.records.frame_record``.
    """

    def __init__(
        self,
        store: Store,
        record: Mapping[str, Any],
        depth_unit_mm: float,
    ) -> None:
        self.record = record
        self._store = store
        self._unit_mm = depth_unit_mm
        self._fetched: dict[str, bytes] = {}  # layer -> bytes, of a data set in object storage

    def __repr__(self) -> str:
        return f"Pair({self.split}/{self.subject}/{self.sequence}_{self.frame:05d})"

    def __getitem__(self, name: str) -> Any:
        """Return an array or a name. Raises KeyError for what ``keys`` does not list."""
        if name not in self._keys():
            raise KeyError(name)
        return getattr(self, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys())

    def __len__(self) -> int:
        return len(self._keys())

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other

    def _keys(self) -> tuple[str, ...]:
        return (*(_ARRAYS.get(layer, layer) for layer in self.record["files"]), *_NAMES)

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

    @property
    def infrared_right(self) -> LayerImage:
        """(H, W) uint16 infrared counts of a stereo camera's second imager."""
        return self.image("infrared_right")

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
                raise DatasetError(no_clean(self._store))
            if layer == "expected":
                raise DatasetError(no_expected(self._store))
            raise DatasetError(
                f"{self._store}: has no layer {layer!r} ({did_you_mean(layer, files)})"
            )
        file = files[layer]
        where = self._store.where(file["name"])
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
        if self._store.is_remote and not self._fetched:
            self._fetched = fetch_images(self._store, self.record["files"])

    def _read(self, layer: str) -> bytes:
        """Read a whole file or a member of a shard; a truncated member is returned truncated."""
        if self._store.is_remote:
            self.fetch()
            return self._fetched[layer]
        file = self.record["files"][layer]
        if "offset" in file:
            return self._store.read_range(file["name"], file["offset"], file["size"])
        data = self._store.read(file["name"], MAX_IMAGE_BYTES)
        if data is None:
            raise missing(self._store.where(file["name"]))
        return data

    def _depth_mm(self, layer: str) -> NDArray[np.float32]:
        return to_mm(self.image(layer), self._unit_mm, self.depth_offset_mm)


def fetch_images(store: Store, files: Mapping[str, Mapping[str, Any]]) -> dict[str, bytes]:
    """Read the images of a frame with one request, for its latency exceeds their transfer.

    Args:
        store: of the data set.
        files: the entry of the frame's record; its layers lie one after another in a shard.

    Returns:
        layer -> bytes, truncated if the file ends before.
    """
    images: dict[str, bytes] = {}
    for name in dict.fromkeys(file["name"] for file in files.values()):
        own = {layer: file for layer, file in files.items() if file["name"] == name}
        start = min(file.get("offset", 0) for file in own.values())
        end = max(file.get("offset", 0) + file["size"] for file in own.values())
        if end - start > sum(file["size"] + _TAR_BYTES for file in own.values()):
            for layer, file in own.items():  # not as we write them: nothing between is read
                images[layer] = store.read_range(name, file.get("offset", 0), file["size"])
            continue
        data = store.read_range(name, start, end - start)
        for layer, file in own.items():
            first = file.get("offset", 0) - start
            images[layer] = data[first : first + file["size"]]
    return images


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
