"""How wide the tensors of an ONNX network become: numbers for each pixel of its input.

Twenty times ``Concat(x, x)`` are a file of 1 kB and a tensor of a million channels, so that the
sizes in a file bound nothing. Channels and area are followed from node to node, without the package
onnx. What a graph computes at run time from sizes, such as outer products, is not foreseen.
"""

from __future__ import annotations

import math
import operator
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from glsim.denoise.wire_format import fields, integers

#: Most numbers of one tensor for each pixel of the input: two maps of the largest model, 4096
#: channels each, side by side. The shipped networks have up to 292, the largest
#: recipe 2042.
MAX_WIDTH: Final = 8192

# Numbers of fields, by message of onnx.proto.
_GRAPH_NODE, _GRAPH_INITIALIZER, _GRAPH_INPUT = 1, 5, 11
_NODE_INPUT, _NODE_OUTPUT, _NODE_OPERATOR, _NODE_ATTRIBUTE = 1, 2, 4, 5
_ATTRIBUTE_NAME, _ATTRIBUTE_INT, _ATTRIBUTE_TENSOR, _ATTRIBUTE_INTS = 1, 3, 5, 8
_TENSOR_DIMS, _TENSOR_TYPE, _TENSOR_NAME, _TENSOR_RAW = 1, 2, 8, 9
_VALUE_NAME = 1
#: Types of tensors whose numbers count -> their form in raw data; up to _FEW of them.
_FORMS: Final = {1: "f", 7: "q"}
_FEW: Final = 8
_SIZES: Final = ("batch", "channels", "area")


def _place(axis: int) -> int:
    """Return the place in _SIZES of an axis of four."""
    return min(axis % 4, 2)


class _Tensor(NamedTuple):
    """What is known of a tensor: maps, channels, and its area as a multiple of the input's.

    Attributes:
        shape: of a constant, or of what operators such as Exp make of one; else empty.
        values: of a constant of few numbers, or what is computed from the batch, as the places
            where ``chunk`` cuts; else empty.
    """

    batch: float = 1.0
    channels: float = 1.0
    area: float = 1.0
    shape: tuple[int, ...] = ()
    values: tuple[float, ...] = ()

    @property
    def width(self) -> float:
        """Numbers for each pixel of the input."""
        return self.batch * self.channels * self.area

    def with_size(self, axis: int, size: float) -> _Tensor:
        """Return a tensor that differs along an axis of (maps, channels, rows, columns)."""
        return self._replace(**{_SIZES[_place(axis)]: size}, shape=(), values=())

    def size(self, axis: int) -> float:
        """Return what is known along an axis; rows and columns: of their product."""
        return (self.batch, self.channels, self.area)[_place(axis)]


@dataclass
class _Node:
    operator: str = ""
    inputs: list[_Tensor] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    numbers: dict[str, list[int]] = field(default_factory=dict)
    constant: _Tensor = field(default_factory=_Tensor)

    def number(self, name: str, default: int) -> int:
        """Return an attribute of one integer."""
        return (self.numbers.get(name) or [default])[0]

    def values(self, place: int) -> tuple[float, ...]:
        """Return the numbers of an input if it is a constant of few."""
        return self.inputs[place].values if place < len(self.inputs) else ()


def check_widths(graph: memoryview, inputs: Callable[[memoryview], int]) -> None:
    """Raise ValueError for a graph with a tensor of more than MAX_WIDTH numbers a pixel.

    Args:
        graph: the bytes of a GraphProto, whose nodes stand in the order in which they run.
        inputs: returns the number of images of an input's bytes.
    """
    known: dict[str, _Tensor] = {"": _Tensor()}  # no name: an optional input that is left out
    for part in fields(graph):
        if part.number == _GRAPH_INITIALIZER:
            name, tensor = _constant(part.data)
            known[name] = tensor
        elif part.number == _GRAPH_INPUT:
            known[_name(part.data)] = _Tensor(channels=inputs(part.data))
    for part in fields(graph):
        if part.number == _GRAPH_NODE:
            node = _read_node(part.data, known)
            tensor = _RULES.get(node.operator, _widest)(node)
            if not tensor.width <= MAX_WIDTH:
                made = f"{tensor.width:.0f} numbers a pixel by {node.operator}"
                raise ValueError(f"makes {made}, more than {MAX_WIDTH}")
            known |= dict.fromkeys(node.outputs, tensor)


def _text(data: memoryview) -> str:
    return bytes(data).decode("utf-8", "replace")


def _name(value: memoryview) -> str:
    return next((_text(part.data) for part in fields(value) if part.number == _VALUE_NAME), "")


def _read_node(data: memoryview, known: dict[str, _Tensor]) -> _Node:
    """Read a node. Raises ValueError if one of its inputs is not known yet."""
    node = _Node()
    for part in fields(data):
        if part.number == _NODE_OPERATOR:
            node.operator = _text(part.data)
        elif part.number == _NODE_OUTPUT:
            node.outputs.append(_text(part.data))
        elif part.number == _NODE_ATTRIBUTE:
            _read_attribute(part.data, node)
        elif part.number == _NODE_INPUT:
            name = _text(part.data)
            if name not in known:
                raise ValueError(f"uses {name!a:.60} before it is made")
            node.inputs.append(known[name])
    return node


def _read_attribute(data: memoryview, node: _Node) -> None:
    name, numbers = "", []
    for part in fields(data):
        if part.number == _ATTRIBUTE_NAME:
            name = _text(part.data)
        elif part.number in (_ATTRIBUTE_INT, _ATTRIBUTE_INTS):
            numbers += integers(part)
        elif part.number == _ATTRIBUTE_TENSOR:
            node.constant = _constant(part.data)[1]
    node.numbers[name] = numbers


def _constant(data: memoryview) -> tuple[str, _Tensor]:
    """Return the name of a TensorProto, and what is known of it."""
    name, shape, form, raw = "", [], "", memoryview(b"")
    for part in fields(data):
        if part.number == _TENSOR_DIMS:
            shape += integers(part)
        elif part.number == _TENSOR_TYPE:
            form = _FORMS.get(part.integer, "")
        elif part.number == _TENSOR_NAME:
            name = _text(part.data)
        elif part.number == _TENSOR_RAW:
            raw = part.data
    values: tuple[float, ...] = ()
    if form and (count := len(raw) // struct.calcsize(form)) <= _FEW:
        values = struct.unpack(f"<{count}{form}", raw[: count * struct.calcsize(form)])
    channels = shape[-3] if len(shape) > 2 else 1
    return name, _Tensor(1.0, channels, 1.0, tuple(shape), values)


def _widest(node: _Node) -> _Tensor:
    """Return the largest sizes of all inputs; of constants alone, the largest shape."""
    tensors = node.inputs or [_Tensor()]
    batch, channels, area = (max(tensor.size(axis) for tensor in tensors) for axis in range(3))
    shapes = [tensor.shape for tensor in tensors]
    return _Tensor(batch, channels, area, max(shapes, key=math.prod) if all(shapes) else ())


def _computed(node: _Node) -> _Tensor:
    """Return the widest input, and the numbers of operators of integers."""
    widest = _widest(node)
    compute = _INTEGERS[node.operator]
    values = [tensor.values for tensor in node.inputs]
    if len(values) != 2 or not (len(values[0]) == len(values[1]) == 1) or 0 in values[1]:
        return widest
    value = compute(values[0][0], values[1][0])
    # Squares of squares would take more memory than any map.
    return widest._replace(values=(value if abs(value) < 2**62 else math.nan,))


def _same(node: _Node) -> _Tensor:
    """Return the first input with its numbers."""
    return node.inputs[0]._replace(shape=()) if node.inputs else _Tensor()


def _first(node: _Node) -> _Tensor:
    """Return the first input: the others are positions and sizes."""
    first = node.inputs[0] if node.inputs else _Tensor()
    return first._replace(shape=(), values=())


def _small(_: _Node) -> _Tensor:
    return _Tensor()


def _shape(node: _Node) -> _Tensor:
    """Return the shape: its batch and channels are known."""
    first = _first(node)
    return _Tensor(values=(int(first.batch), int(first.channels), math.nan, math.nan))


def _made(node: _Node) -> _Tensor:
    return node.constant


def _concat(node: _Node) -> _Tensor:
    axis = node.number("axis", 1)
    return _widest(node).with_size(axis, sum(tensor.size(axis) for tensor in node.inputs))


def _strides(node: _Node) -> int:
    return math.prod(max(1, stride) for stride in node.numbers.get("strides", []))


def _convolution(node: _Node) -> _Tensor:
    """The weights' shape is (output, input / groups, rows, columns)."""
    first = _first(node)
    weights = node.inputs[1].shape if len(node.inputs) > 1 else ()
    channels = weights[0] if weights else MAX_WIDTH  # computed weights: of any size
    return _Tensor(first.batch, channels, first.area / _strides(node))


def _transposed_convolution(node: _Node) -> _Tensor:
    """The weights' shape is (input, output / groups, rows, columns)."""
    first = _first(node)
    weights = node.inputs[1].shape if len(node.inputs) > 1 else ()
    channels = weights[1] * max(1, node.number("group", 1)) if len(weights) > 1 else MAX_WIDTH
    return _Tensor(first.batch, channels, first.area * _strides(node))


def _pooling(node: _Node) -> _Tensor:
    first = _first(node)
    return first._replace(area=first.area / _strides(node))


def _product(node: _Node) -> _Tensor:
    """Return the widest input, wider as a constant factor is wider than it is long."""
    widest = _widest(node)._replace(shape=())
    for tensor in node.inputs[1:2]:
        if len(tensor.shape) > 1:
            sides = sorted(max(1, side) for side in tensor.shape[-2:])
            return widest._replace(area=widest.area * sides[1] / sides[0])
    return widest


def _resize(node: _Node) -> _Tensor:
    """Its third input is scales; without, it has the size of another map."""
    first = _first(node)
    scales = node.values(2)
    larger = math.prod(max(0.0, scale) for scale in scales)
    return first._replace(area=first.area * larger if scales else max(first.area, 1.0))


def _slice(node: _Node) -> _Tensor:
    """Inputs: data, starts, ends, axes."""
    first = _first(node)
    bounds = (node.values(1), node.values(2), node.values(3))
    for start, end, axis in zip(*bounds, strict=False):
        if axis in (-4, -3, 0, 1) and 0 <= start < end:
            left = max(1.0, min(end, first.size(int(axis))) - start)
            first = first.with_size(int(axis), left)
    return first


def _gather(node: _Node) -> _Tensor:
    axis = node.number("axis", 0)
    count = max(1, math.prod(node.inputs[1].shape if len(node.inputs) > 1 else ()))
    first = _first(node)
    values, places = node.values(0), node.values(1)
    if len(values) == 4 and len(places) == 1 and abs(places[0]) < 4:  # of a shape
        return first._replace(values=(values[int(places[0])],))
    return first.with_size(axis, count if _place(axis) < 2 else first.area * count)


def _expand(node: _Node) -> _Tensor:
    first = _first(node)
    sides = math.prod(max(1.0, abs(side)) for side in node.values(1))
    return first._replace(channels=max(first.channels, sides))


_INTEGERS: Final[dict[str, Callable[[float, float], float]]] = {
    "Add": operator.add,
    "Div": operator.floordiv,
    "Mul": operator.mul,
    "Sub": operator.sub,
}
_RULES: Final[dict[str, Callable[[_Node], _Tensor]]] = {
    "Concat": _concat,
    "Constant": _made,
    "Conv": _convolution,
    "ConvTranspose": _transposed_convolution,
    "Expand": _expand,
    "Gather": _gather,
    "Gemm": _product,
    "MatMul": _product,
    "Resize": _resize,
    "Slice": _slice,
    **dict.fromkeys(("AveragePool", "MaxPool"), _pooling),
    "Shape": _shape,
    **dict.fromkeys(_INTEGERS, _computed),
    **dict.fromkeys(("Cast", "Identity", "Squeeze", "Unsqueeze"), _same),
    **dict.fromkeys(("ConstantOfShape", "Size"), _small),
    **dict.fromkeys(("Pad", "Reshape", "Split"), _first),
}
