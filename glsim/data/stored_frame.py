"""Reading of a data set's frame as a ``DepthFrame``, with images checked against the record."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Distortion, Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey
from glsim.core.errors import DatasetError
from glsim.core.files.atomic import checksum, missing
from glsim.core.files.png import MAX_IMAGE_BYTES
from glsim.core.files.store import Store
from glsim.core.reason import Reason
from glsim.core.units import from_steps
from glsim.data.header import REPAIR
from glsim.data.layer_images import LayerImage, decode_layer
from glsim.data.recordings.names import DEPTH_LAYERS
from glsim.simulation.frame import decode_normals

#: Largest gap between two members of a shard, bytes: a header, and the rest of the last block.
_TAR_BYTES = 1024


def stored_frame(
    store: Store, record: Mapping[str, Any], step_mm: float, lens: Distortion
) -> DepthFrame:
    """Return a frame of a data set; it reads and checks each image at its first use.

    The offset of the files is added, so that its depths are measured depths.
    """
    images = StoredImages(store, record, step_mm)
    layers: dict[str, Any] = {}
    for layer in record["files"]:
        if layer in DEPTH_LAYERS:
            layers[f"{layer}_mm"] = partial(images.depth_mm, layer)
        else:
            layers[layer] = partial(images.read, layer)
    if "normals" in layers:
        layers["normals"] = images.normals
    key = FrameKey(str(record["subject"]), str(record["sequence"]), int(record["frame"]))
    return DepthFrame(
        key, Intrinsics(**record["intrinsics"]), layers, step_mm=step_mm, record=record,
        name=f"{record['split']}/{key}", lens=lens,
    )  # fmt: skip


class StoredImages:
    """A reader of one frame's images, which fetches remote images by one request."""

    def __init__(self, store: Store, record: Mapping[str, Any], step_mm: float) -> None:
        self._store, self._record, self._step_mm = store, record, step_mm
        self._fetched: dict[str, bytes] = {}  # layer -> bytes, of a data set in object storage

    def read(self, layer: str) -> LayerImage:
        """Read a layer's pixels: (H, W) uint16 or uint8; "normals" and "color" (H, W, 3).

        Raises DatasetError if the file is missing, was changed, or is of another type or size.
        """
        file = self._record["files"][layer]
        where = self._store.where(file["name"])
        if "member" in file:
            where += f" ({file['member']})"
        data = self._bytes(layer)
        if checksum(data) != {"size": file["size"], "crc32": file["crc32"]}:
            raise DatasetError(
                f"{where}: was changed after it was written ({len(data)} bytes, {file['size']} "
                f"recorded): {REPAIR}"
            )
        image = decode_layer(data, layer, where)
        size = (self._record["intrinsics"]["height"], self._record["intrinsics"]["width"])
        if image.shape[:2] != size:
            raise DatasetError(
                f"{where}: is {image.shape[1]} x {image.shape[0]} pixels, the record says "
                f"{size[1]} x {size[0]}"
            )
        if layer == "reason" and image.max(initial=0) > max(Reason):
            raise DatasetError(f"{where}: holds {image.max()}, which is no code of a reason")
        return image

    def depth_mm(self, layer: str) -> NDArray[np.float32]:
        """Read a depth layer as (H, W) float32 mm from the camera, 0 = no depth."""
        steps = np.asarray(self.read(layer), np.uint16)
        return from_steps(steps, self._step_mm, float(self._record["depth_offset_mm"]))

    def normals(self) -> NDArray[np.float32]:
        """Read the unit normals, (H, W, 3) float32."""
        return decode_normals(np.asarray(self.read("normals"), np.uint16))

    def _bytes(self, layer: str) -> bytes:
        """Read a layer's file or shard member, which may be shorter than recorded."""
        if self._store.is_remote:
            if not self._fetched:
                self._fetched = _fetch_images(self._store, self._record["files"])
            return self._fetched[layer]
        file = self._record["files"][layer]
        if "offset" in file:
            return self._store.read_range(file["name"], file["offset"], file["size"])
        data = self._store.read(file["name"], MAX_IMAGE_BYTES)
        if data is None:
            raise missing(self._store.where(file["name"]))
        return data


def _fetch_images(store: Store, files: Mapping[str, Mapping[str, Any]]) -> dict[str, bytes]:
    """Read the bytes of a frame's remote images, layer -> bytes, short if a file ends early.

    Adjacent images in a shard are read by one request: its latency exceeds their transfer time.
    """
    places = {layer: (file.get("offset", 0), file["size"]) for layer, file in files.items()}
    names = {layer: file["name"] for layer, file in files.items()}
    start = min(offset for offset, _ in places.values())
    whole = max(offset + size for offset, size in places.values()) - start
    most = sum(size + _TAR_BYTES for _, size in places.values())
    if len(set(names.values())) > 1 or whole > most:
        return {layer: store.read_range(names[layer], *places[layer]) for layer in files}
    data = store.read_range(next(iter(names.values())), start, whole)
    return {n: data[offset - start :][:size] for n, (offset, size) in places.items()}
