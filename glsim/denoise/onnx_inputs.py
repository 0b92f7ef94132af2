"""What an ONNX file declares, read from its bytes without the package onnx: inputs and protocol.

The numbers below are those of onnx.proto. The graph itself is not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from glsim.denoise.inputs import AFTER, BEFORE, DEPTH, INFRARED, NetworkInputs
from glsim.denoise.wire_format import fields
from glsim.depth_protocol import DepthProtocol, check_protocol

#: ModelProto.graph, GraphProto.input, ValueInfoProto.name and .type, TypeProto.tensor_type,
#: TypeProto.Tensor.shape, TensorShapeProto.dim, Dimension.dim_value.
_GRAPH, _INPUT, _NAME, _TYPE, _TENSOR, _SHAPE, _DIM, _DIM_VALUE = 7, 11, 1, 2, 1, 2, 1, 1
#: ModelProto.metadata_props, StringStringEntryProto.key and .value.
_METADATA, _KEY, _VALUE = 14, 1, 2
#: Key of the protocol of the training, see glsim.depth_protocol; a file without it is of depth.
_PROTOCOL_KEY: Final = b"glsim.protocol"
#: Axis of the images of an input, (1, images, H, W).
_IMAGES_AXIS: Final = 1


def read_inputs(data: bytes) -> NetworkInputs:
    """Return what a network of ``glsim export`` sees. Raises ValueError for anything else."""
    counts = {}
    for graph in _messages(memoryview(data), _GRAPH):
        for value in _messages(graph, _INPUT):
            name = bytes(next(_messages(value, _NAME), b"")).decode("utf-8", "replace")
            counts[name] = images(value)
    if counts.get(DEPTH) != 1 or counts.keys() - {DEPTH, INFRARED, BEFORE, AFTER}:
        raise ValueError(f"its inputs are {', '.join(map(repr, counts)) or 'none'}")
    return NetworkInputs(INFRARED in counts, counts.get(BEFORE, 0), counts.get(AFTER, 0))


def read_protocol(data: bytes) -> DepthProtocol:
    """Return the protocol that a network was trained under. Raises ConfigError for no protocol."""
    for entry in _messages(memoryview(data), _METADATA):
        if bytes(next(_messages(entry, _KEY), b"")) == _PROTOCOL_KEY:
            text = bytes(next(_messages(entry, _VALUE), b"")).decode("utf-8", "replace")
            return check_protocol(text, "protocol") or "depth"
    return "depth"


def protocol_entry(protocol: DepthProtocol) -> bytes:
    """Return what to append to a file so that ``read_protocol`` returns ``protocol``.

    Protocol Buffers join the fields of concatenated messages. Every text is shorter than 128 bytes,
    so that a length is one byte.
    """

    def field(number: int, content: bytes) -> bytes:
        return bytes([number << 3 | 2, len(content)]) + content

    entry = field(_KEY, _PROTOCOL_KEY) + field(_VALUE, protocol.encode())
    return field(_METADATA, entry)


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


def _messages(message: memoryview, number: int) -> Iterator[memoryview]:
    for field in fields(message):
        if field.number == number:
            yield field.data
