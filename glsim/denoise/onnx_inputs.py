"""Read the inputs and the record of a network from an ONNX file, without the package onnx.

The numbers below are those of onnx.proto. The graph itself is not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from glsim.denoise.composites import DOUBT
from glsim.denoise.inputs import AFTER, BEFORE, DEPTH, INFRARED, NetworkInputs
from glsim.denoise.record import DEFAULT_RECORD, NetworkRecord
from glsim.denoise.wire_format import fields
from glsim.depth_protocol import check_protocol

#: ModelProto.graph, GraphProto.input, ValueInfoProto.name and .type, TypeProto.tensor_type,
#: TypeProto.Tensor.shape, TensorShapeProto.dim, Dimension.dim_value.
_GRAPH, _INPUT, _NAME, _TYPE, _TENSOR, _SHAPE, _DIM, _DIM_VALUE = 7, 11, 1, 2, 1, 2, 1, 1
#: ModelProto.metadata_props, StringStringEntryProto.key and .value.
_METADATA, _KEY, _VALUE = 14, 1, 2
#: Prefix of the keys of a record, before the names of its fields; what is default has no entry.
_PREFIX: Final = "glsim."
#: Axis of the images of an input, (1, images, H, W).
_IMAGES_AXIS: Final = 1


def read_inputs(data: bytes) -> NetworkInputs:
    """Return what a network of ``glsim export`` sees. Raises ValueError for anything else."""
    counts = {}
    for graph in _messages(memoryview(data), _GRAPH):
        for value in _messages(graph, _INPUT):
            counts[_text(value, _NAME)] = images(value)
    if counts.get(DEPTH) != 1 or counts.keys() - {DEPTH, INFRARED, BEFORE, AFTER}:
        raise ValueError(f"its inputs are {', '.join(map(repr, counts)) or 'none'}")
    return NetworkInputs(INFRARED in counts, counts.get(BEFORE, 0), counts.get(AFTER, 0))


def read_record(data: bytes) -> NetworkRecord:
    """Read the record of a network.

    Args:
        data: the ONNX file.

    Returns:
        Its record, with the default of each setting that the file lacks.

    Raises:
        ValueError: for a setting that is no number or out of range, or a damaged file.
        ConfigError: for an unknown protocol.
    """
    text = {
        _text(entry, _KEY): _text(entry, _VALUE) for entry in _messages(memoryview(data), _METADATA)
    }
    margin_px = int(text.get(f"{_PREFIX}margin_px", DEFAULT_RECORD.margin_px))
    if margin_px < DEFAULT_RECORD.margin_px:
        raise ValueError(f"its margin_px is {margin_px}")
    unlikely = float(text.get(f"{_PREFIX}unlikely", DEFAULT_RECORD.unlikely))
    if not 0 < unlikely < DOUBT:
        raise ValueError(f"its unlikely is {unlikely}")
    return NetworkRecord(
        check_protocol(text.get(f"{_PREFIX}protocol"), "protocol") or DEFAULT_RECORD.protocol,
        bool(int(text.get(f"{_PREFIX}keep_clean", DEFAULT_RECORD.keep_clean))),
        margin_px,
        unlikely,
    )


def record_entries(record: NetworkRecord) -> bytes:
    """Encode a record as bytes to append to an ONNX file; settings with their default take none.

    Protocol Buffers join the fields of concatenated messages. Every text is shorter than 128 bytes,
    so that a length is one byte.
    """

    def field(number: int, content: bytes) -> bytes:
        return bytes([number << 3 | 2, len(content)]) + content

    entries = b""
    for name, default in DEFAULT_RECORD._asdict().items():
        value = getattr(record, name)
        if value != default:
            text = value if isinstance(value, str) else f"{value:g}"
            entry = field(_KEY, f"{_PREFIX}{name}".encode()) + field(_VALUE, text.encode())
            entries += field(_METADATA, entry)
    return entries


def images(value: memoryview) -> int:
    """Return the number of images of an input."""
    for kind in _messages(value, _TYPE):
        for tensor in _messages(kind, _TENSOR):
            for shape in _messages(tensor, _SHAPE):
                dims = list(_messages(shape, _DIM))
                if len(dims) <= _IMAGES_AXIS:
                    continue
                for field in fields(dims[_IMAGES_AXIS]):
                    if field.number == _DIM_VALUE:
                        return field.integer
    raise ValueError("an input has no number of images")


def _text(message: memoryview, number: int) -> str:
    return bytes(next(_messages(message, number), b"")).decode("utf-8", "replace")


def _messages(message: memoryview, number: int) -> Iterator[memoryview]:
    for field in fields(message):
        if field.number == number:
            yield field.data
