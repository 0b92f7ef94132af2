"""Check an ONNX file before a runtime reads it: operators, sizes of tensors, other files.

A runtime takes the memory that a tensor's dimensions ask for, and opens the files that it names as
its external data. The form of the file: ``onnx.proto`` (ONNX 1.17).
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from typing import Final

from glsim.denoise.onnx_inputs import images
from glsim.denoise.onnx_widths import check_widths
from glsim.denoise.wire_format import fields, integers

#: The operators of convolutional networks: those that ``glsim export`` writes, and more of their
#: kind. Others of ONNX would only be more ways to take memory (Tile, Range, OneHot) or to run long
#: (Loop, Scan).
_OPERATOR_NAMES: Final = """
    Abs Acos Add And ArgMax ArgMin Asin Asinh Atan AveragePool BatchNormalization Cast Ceil Clip
    Concat Constant ConstantOfShape Conv ConvTranspose Cos Cosh DepthToSpace Div Elu Equal Erf Exp
    Expand Flatten Floor Gather GatherElements GatherND Gelu Gemm GlobalAveragePool GlobalMaxPool
    Greater GreaterOrEqual GridSample GroupNormalization HardSigmoid HardSwish Identity
    InstanceNormalization IsInf IsNaN LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax
    MatMul Max MaxPool Mean Min Mish Mod Mul Neg Not Or Pad Pow PRelu Reciprocal ReduceL1 ReduceL2
    ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum ReduceSumSquare Relu Reshape Resize Round
    ScatterElements ScatterND Shape Sigmoid Sign Sin Sinh Size Slice Softmax Softplus SpaceToDepth
    Split Sqrt Squeeze Sub Sum Tan Tanh TopK Transpose Unsqueeze Where Xor
"""
_OPERATORS: Final = frozenset(_OPERATOR_NAMES.split())
#: Most nodes; the largest shipped recipe (Restormer) has 5,500.
_MAX_NODES: Final = 20_000
#: Most convolutions and matrix products: a runtime's time to load grows with their square, to 10 s.
_MAX_PRODUCTS: Final = 1000
_PRODUCTS: Final = frozenset({"Conv", "ConvTranspose", "Gemm", "MatMul"})
#: Largest whole number in a graph: twice the channels of the largest model. Numbers beyond
#: _ENDLESS mean "to the end" in Slice. Largest product of the numbers of one tensor, which may be
#: a shape: 268 MB of float32.
_MAX_NUMBER: Final = 8192
_ENDLESS: Final = 2**62
_MAX_PRODUCT: Final = 2**26

# Numbers of fields, by message.
_MODEL_GRAPH, _MODEL_FUNCTIONS = 7, 25
_GRAPH_NODE, _GRAPH_INITIALIZER, _GRAPH_SPARSE = 1, 5, 15
_NODE_OPERATOR, _NODE_ATTRIBUTE, _NODE_DOMAIN = 4, 5, 7
_ATTRIBUTE_TENSOR, _ATTRIBUTE_INTS = 5, (3, 8)
_ATTRIBUTE_OTHER = (6, 10, 11, 22, 23)  # graphs, lists of tensors, sparse tensors
_TENSOR_DIMS, _TENSOR_TYPE, _TENSOR_INTS = 1, 2, (5, 7)
_TENSOR_RAW, _TENSOR_EXTERNAL, _TENSOR_LOCATION = 9, 13, 14
#: Types of whole numbers -> their form in raw data.
_WHOLE: Final = {6: "i", 7: "q"}


def check_onnx(data: bytes) -> None:
    """Raise ValueError, with the reason, for a file that ``glsim export`` cannot have written."""
    graphs = [field.data for field in fields(memoryview(data)) if field.number == _MODEL_GRAPH]
    if any(field.number == _MODEL_FUNCTIONS for field in fields(memoryview(data))):
        raise ValueError("defines functions")
    if len(graphs) != 1:
        raise ValueError("holds no graph" if not graphs else "holds several graphs")
    operators: Counter[str] = Counter()
    for part in fields(graphs[0]):
        if part.number == _GRAPH_NODE:
            operators[_check_node(part.data)] += 1
        elif part.number == _GRAPH_INITIALIZER:
            _check_tensor(part.data)
        elif part.number == _GRAPH_SPARSE:
            raise ValueError("holds sparse tensors")
    if (products := sum(operators[name] for name in _PRODUCTS)) > _MAX_PRODUCTS:
        raise ValueError(f"has {products} convolutions and products, more than {_MAX_PRODUCTS}")
    if (nodes := operators.total()) > _MAX_NODES:
        raise ValueError(f"has {nodes} nodes, more than {_MAX_NODES}")
    check_widths(graphs[0], images)


def _check_node(node: memoryview) -> str:
    """Check a node; return its operator."""
    operator = domain = ""
    for field in fields(node):
        if field.number == _NODE_OPERATOR:
            operator = bytes(field.data).decode(errors="replace")
        elif field.number == _NODE_DOMAIN:
            domain = bytes(field.data).decode(errors="replace")
        elif field.number == _NODE_ATTRIBUTE:
            _check_attribute(field.data)
    if domain or operator not in _OPERATORS:
        raise ValueError(f"uses the operator {f'{domain} {operator}'.strip()!a:.60}")
    return operator


def _check_attribute(attribute: memoryview) -> None:
    numbers: list[int] = []
    for field in fields(attribute):
        if field.number == _ATTRIBUTE_TENSOR:
            _check_tensor(field.data)
        elif field.number in _ATTRIBUTE_OTHER:
            raise ValueError("holds a graph in a node")
        elif field.number in _ATTRIBUTE_INTS:
            numbers += integers(field)
    _check_numbers(numbers)


def _check_tensor(tensor: memoryview) -> None:
    """Raise ValueError for a tensor that is larger than its bytes, or keeps them elsewhere."""
    shape: list[int] = []
    numbers: list[int] = []
    kind, raw = 0, memoryview(b"")
    for field in fields(tensor):
        if field.number == _TENSOR_EXTERNAL or (field.number == _TENSOR_LOCATION and field.integer):
            raise ValueError("keeps weights in another file")
        if field.number == _TENSOR_DIMS:
            shape += integers(field)
        elif field.number == _TENSOR_TYPE:
            kind = field.integer
        elif field.number == _TENSOR_RAW:
            raw = field.data
        elif field.number in _TENSOR_INTS:
            numbers += integers(field)
    if any(side < 0 for side in shape) or math.prod(shape) > len(tensor):
        raise ValueError(f"holds a tensor of shape {shape!s:.60} in {len(tensor)} bytes")
    if form := _WHOLE.get(kind):
        size = struct.calcsize(form)
        numbers += struct.unpack(f"<{len(raw) // size}{form}", raw[: len(raw) // size * size])
    _check_numbers(numbers)


def _check_numbers(numbers: list[int]) -> None:
    product = 1
    for number in numbers:
        if abs(number) >= _ENDLESS:
            continue
        if abs(number) > _MAX_NUMBER:
            raise ValueError(f"holds the number {number}, larger than any size in a network")
        product *= max(1, abs(number))
        if product > _MAX_PRODUCT:
            raise ValueError(f"holds the shape {numbers!s:.60}")
