"""Decode the samples that the library webdataset reads from our shards, without loss."""

from __future__ import annotations

from typing import Any

from glsim.dataset.layer_images import LAYER_TYPES, LayerImage, decode_layer
from glsim.dataset.record_schema import MAX_LINE_BYTES, parse_frame
from glsim.errors import DatasetError


def webdataset_decoder(key: str, data: bytes) -> LayerImage | dict[str, Any] | None:
    """Decode a member of a shard: ``WebDataset(shards).decode(webdataset_decoder)``.

    Raises DatasetError for a damaged image or record.

    Returns (H, W) uint16 as stored for a layer of depth or infrared, uint8 for "reason" and
    "regions", (H, W, 3) uint16 for "normals"; the checked record for "json" (its
    ``depth_offset_mm`` is to be added to depths times the set's ``depth_unit_mm``); None for any
    other member, which leaves it to the next decoder. The library's own ``decode("pil")`` gives 8
    bits, and 255 for every depth above 255.

    Args:
        key: what follows the sample's number, as that library gives it: ".noisy.png", ".json".
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
