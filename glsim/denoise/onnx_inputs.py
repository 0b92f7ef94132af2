"""The inputs that an ONNX file declares, read from its bytes without the package onnx.

An ONNX file is a protocol buffer. A message is a sequence of fields, each a number and a value; the
numbers below are those of onnx.proto. Only the graph's inputs are read, everything else is skipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from glsim.denoise.inputs import AFTER, BEFORE, DEPTH, INFRARED, Inputs

#: ModelProto.graph, GraphProto.input, ValueInfoProto.name and .type, TypeProto.tensor_type,
#: TypeProto.Tensor.shape, TensorShapeProto.dim, Dimension.dim_value.
_GRAPH, _INPUT, _NAME, _TYPE, _TENSOR, _SHAPE, _DIM, _DIM_VALUE = 7, 11, 1, 2, 1, 2, 1, 1
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
#: Axis of the images of an input, (1, images, H, W).
_IMAGES_AXIS: Final = 1


def read_inputs(data: bytes) -> Inputs:
    """Return what a network of ``glsim export`` sees. Raises ValueError for anything else."""
    counts = {}
    for graph in _messages(data, _GRAPH):
        for value in _messages(graph, _INPUT):
            name = next(_messages(value, _NAME), b"").decode("utf-8", "replace")
            counts[name] = _images(value)
    if counts.get(DEPTH) != 1 or counts.keys() - {DEPTH, INFRARED, BEFORE, AFTER}:
        raise ValueError(f"its inputs are {', '.join(map(repr, counts)) or 'none'}")
    return Inputs(INFRARED in counts, counts.get(BEFORE, 0), counts.get(AFTER, 0))


def _images(value: bytes) -> int:
    """Return the number of images of an input."""
    for kind in _messages(value, _TYPE):
        for tensor in _messages(kind, _TENSOR):
            for shape in _messages(tensor, _SHAPE):
                dims = list(_messages(shape, _DIM))
                sizes = dict(_fields(dims[_IMAGES_AXIS])) if len(dims) > _IMAGES_AXIS else {}
                size = sizes.get(_DIM_VALUE)
                if isinstance(size, int):
                    return size
    raise ValueError("an input has no number of images")


def _messages(message: memoryview | bytes, number: int) -> Iterator[bytes]:
    for field, value in _fields(message):
        if field == number and isinstance(value, bytes):
            yield value


def _fields(message: memoryview | bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield number and value of each field. Raises ValueError for bytes that are no message."""
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        number, kind = tag >> 3, tag & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield number, value
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in (_FIXED64, _FIXED32):
            size = 8 if kind == _FIXED64 else 4
        else:
            raise ValueError("is no protocol buffer")
        if at + size > len(message):
            raise ValueError("ends too early")
        yield number, bytes(message[at : at + size])
        at += size


def _varint(message: memoryview | bytes, at: int) -> tuple[int, int]:
    """Return an integer of 7 bits per byte, lowest first, and the place after it."""
    value = 0
    for shift in range(0, 64, 7):
        if at >= len(message):
            raise ValueError("ends too early")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("is no protocol buffer")
