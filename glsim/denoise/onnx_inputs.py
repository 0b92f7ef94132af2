"""The inputs that an ONNX file declares, read from its bytes without the package onnx.

The numbers below are those of onnx.proto. Only the graph's inputs are read.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from glsim.denoise.inputs import AFTER, BEFORE, DEPTH, INFRARED, Inputs
from glsim.denoise.wire_format import fields

#: ModelProto.graph, GraphProto.input, ValueInfoProto.name and .type, TypeProto.tensor_type,
#: TypeProto.Tensor.shape, TensorShapeProto.dim, Dimension.dim_value.
_GRAPH, _INPUT, _NAME, _TYPE, _TENSOR, _SHAPE, _DIM, _DIM_VALUE = 7, 11, 1, 2, 1, 2, 1, 1
#: Axis of the images of an input, (1, images, H, W).
_IMAGES_AXIS: Final = 1


def read_inputs(data: bytes) -> Inputs:
    """Return what a network of ``glsim export`` sees. Raises ValueError for anything else."""
    counts = {}
    for graph in _messages(memoryview(data), _GRAPH):
        for value in _messages(graph, _INPUT):
            name = bytes(next(_messages(value, _NAME), b"")).decode("utf-8", "replace")
            counts[name] = _images(value)
    if counts.get(DEPTH) != 1 or counts.keys() - {DEPTH, INFRARED, BEFORE, AFTER}:
        raise ValueError(f"its inputs are {', '.join(map(repr, counts)) or 'none'}")
    return Inputs(INFRARED in counts, counts.get(BEFORE, 0), counts.get(AFTER, 0))


def _images(value: memoryview) -> int:
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
