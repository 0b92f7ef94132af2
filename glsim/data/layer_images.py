"""Layer images: pixel types, checked decoding, and writing of a frame's layers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError
from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import MAX_SIDE_PX, decode_png, encode_png, size_problem
from glsim.data.record_schema import MAX_LINE_BYTES, parse_frame
from glsim.data.recordings.names import DEPTH_LAYERS
from glsim.simulation.frame import Frame

LayerImage = NDArray[np.uint16] | NDArray[np.uint8]

LAYER_TYPES: dict[str, np.dtype[np.uint16] | np.dtype[np.uint8]] = {
    **dict.fromkeys((*DEPTH_LAYERS, "normals"), np.dtype(np.uint16)),
    **dict.fromkeys(("infrared", "infrared_right"), np.dtype(np.uint16)),
    **dict.fromkeys(("reason", "regions", "color"), np.dtype(np.uint8)),
}

#: Channels of the layers that have several.
CHANNELS = {"normals": 3, "color": 3}


def decode_layer(data: bytes, layer: str, where: str, max_px: int = MAX_SIDE_PX**2) -> LayerImage:
    """Decode a PNG file to (H, W) or (H, W, 3) pixels of the layer's type, with checks.

    Raises DatasetError for damage, another pixel type, channels, or more than ``max_px`` pixels.
    """
    image = decode_png(data, max_px)
    if image is None:
        problem = (
            size_problem(data, max_px) or "is no readable PNG image: it is damaged or incomplete"
        )
        raise DatasetError(f"{where}: {problem}")
    expected = LAYER_TYPES[layer]
    if image.dtype != expected:
        raise DatasetError(
            f"{where}: has {image.dtype.itemsize * 8} bits a pixel, {layer} needs "
            f"{expected.itemsize * 8}: another program saved it again"
        )
    channels = image.shape[2] if image.ndim == 3 else 1
    if channels != CHANNELS.get(layer, 1):
        wanted = "one" if layer not in CHANNELS else "three"
        raise DatasetError(f"{where}: has {channels} channels instead of {wanted}")
    if channels == 3:
        image = np.ascontiguousarray(image[..., ::-1])  # OpenCV has blue first
    return image.view(expected)


def layer_png(frame: Frame, layer: str, sensor: str = "") -> bytes:
    """Encode a layer of a frame; it states its name and its simulated sensor, depth its step."""
    unit_mm = frame.depth_unit_mm if layer in DEPTH_LAYERS else None
    return encode_png(frame.image(layer), unit_mm, sensor, layer)


def write_frame(
    frame: Frame, directory: Path, stem: str, layers: Sequence[str], sensor: str = ""
) -> list[Path]:
    """Write ``<stem>_<layer>.png`` for each layer and return the paths.

    Existing files are replaced, and every file is complete or absent. Raises ConfigError for an
    unknown layer or a depth that does not fit 16 bits, DatasetError if a file cannot be written.
    """
    files = {directory / f"{stem}_{n}.png": layer_png(frame, n, sensor) for n in layers}
    for path, image in files.items():
        write_atomic(image, path)
    return list(files)


def webdataset_decoder(key: str, data: bytes) -> LayerImage | dict[str, Any] | None:
    """Decode a member of a shard, for ``WebDataset(shards).decode(webdataset_decoder)``.

    Raises DatasetError for a damaged image or record.

    Returns for a layer of depth or infrared: (H, W) uint16 as stored; "reason", "regions": (H, W)
    uint8; "normals": (H, W, 3) uint16; "color": (H, W, 3) uint8; "json": the checked record. Depth
    in mm is the stored number times the set's ``depth_unit_mm``, plus the record's
    ``depth_offset_mm``. Any other member gives None, and the next decoder is asked. The library's
    ``decode("pil")`` would give 8 bits, with 255 for every depth above 255.

    ``key``: the member's name after the sample's number, such as ".noisy.png" or ".json".
    """
    name = key.lstrip(".")
    if name == "json":
        if len(data) > MAX_LINE_BYTES:
            raise DatasetError(f"a record of a shard has {len(data)} bytes")
        return parse_frame(data, "a record of a shard")
    layer = name.removesuffix(".png")
    if layer == name or layer not in LAYER_TYPES:
        return None
    return decode_layer(data, layer, f"a member {name} of a shard")
