"""Compaction of an exported ONNX graph, which then loads faster and gives equal results.

PyTorch's exporter computes the sides of every padding and the ends of every slice in the graph, and
names no shape. onnxruntime derives the shapes as formulas that grow from slice to slice, so that
the time to load grows with the square of the number of nodes: 3 CPU s for the 3,900 nodes of
``face``, 0.1 s with written shapes.

The graph is evaluated for three sizes of the frame: enough to tell constants from sides, which
are affine in rows or columns. Numbers that are equal for all become constants; ends of slices at a
constant distance from the end of the axis become this distance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from onnx.reference import ReferenceEvaluator

#: Rows and columns of the frames, px: multiples of 16 (``glsim.networks.network``), all different.
_SIZES: Final = ((96, 208), (144, 80), (240, 64))
_ENDLESS: Final = np.iinfo(np.int64).max
#: Operators whose output shape depends on values of their inputs, not on shapes alone.
_UNCLEAR: Final = frozenset({"Slice", "Pad", "Resize", "Reshape", "Expand", "ConstantOfShape"})

_Values = dict[str, NDArray[Any]]
_Shapes = dict[str, tuple[int, ...]]


def compacted(data: bytes, entries: Mapping[str, str] | None = None) -> bytes:
    """Compact an ONNX file: short names, known shapes, each constant once; add metadata.

    PyTorch stores the numbers of each Slice as separate nodes, and the module's path in each name.
    """
    model = onnx.load_from_string(data)
    _write_shapes(model)
    _shorten(model.graph)
    helper.set_model_props(model, dict(entries or {}))
    return bytes(model.SerializeToString())


def _shorten(graph: onnx.GraphProto) -> None:
    """Merge equal tensors and give all tensors short names, in place."""
    public = {value.name for value in (*graph.input, *graph.output)}
    names: dict[str, str] = {}
    first: dict[tuple[int, tuple[int, ...], bytes], str] = {}
    tensors = []
    for tensor in graph.initializer:
        value = (tensor.data_type, tuple(tensor.dims), numpy_helper.to_array(tensor).tobytes())
        names[tensor.name] = first.setdefault(value, tensor.name)
        if names[tensor.name] == tensor.name:
            tensors.append(tensor)

    def short(name: str) -> str:
        name = names.get(name, name)
        if name in public or not name:
            return name
        return shortened.setdefault(name, f"v{len(shortened):x}")

    shortened: dict[str, str] = {}
    for node in graph.node:
        node.name = ""
        node.input[:] = [short(name) for name in node.input]
        node.output[:] = [short(name) for name in node.output]
    for named in (*tensors, *graph.value_info):
        named.name = short(named.name)
    short_graph = helper.make_graph(
        graph.node, "glsim", graph.input, graph.output, tensors, value_info=graph.value_info
    )
    graph.CopyFrom(short_graph)


class _Known(NamedTuple):
    values: _Values
    shapes: _Shapes


def _write_shapes(model: onnx.ModelProto) -> None:
    """Write the shapes of the tensors into a network, without computations of sizes, in place."""
    graph = model.graph
    constants = {tensor.name: numpy_helper.to_array(tensor) for tensor in graph.initializer}
    constants |= {
        node.output[0]: numpy_helper.to_array(node.attribute[0].t)
        for node in graph.node
        if node.op_type == "Constant"
    }
    known = [_evaluate(model, dict(constants), rows, columns) for rows, columns in _SIZES]
    for name, value in known[0].values.items():
        if value.dtype.kind == "f":  # other programs may round differently
            continue
        if all(name in k.values and np.array_equal(value, k.values[name]) for k in known):
            constants.setdefault(name, value)
    nodes = []
    for node in graph.node:
        if constants.keys() >= {*node.output}:
            continue
        copy = onnx.NodeProto()
        copy.CopyFrom(node)
        if node.op_type == "Slice" and node.input[2] not in constants:
            _fix_ends(copy, known, constants)
        nodes.append(copy)
    needed = {output.name for output in graph.output}
    reached: list[onnx.NodeProto] = []  # the nodes on which outputs depend
    for node in reversed(nodes):
        if needed.intersection(node.output):
            reached.insert(0, node)
            needed.update(node.input)
    tensors = [numpy_helper.from_array(v, n) for n, v in constants.items() if n in needed]
    made = helper.make_graph(reached, graph.name, graph.input, graph.output, tensors)
    inferred = onnx.shape_inference.infer_shapes(model).graph.value_info
    types = {value.name: value.type.tensor_type.elem_type for value in inferred}
    made.value_info.extend(
        helper.make_tensor_value_info(name, types[name], form)
        for node in reached
        if node.op_type in _UNCLEAR
        for name in node.output
        if name in types and (form := _form(name, known)) is not None
    )
    graph.CopyFrom(made)


def _evaluate(model: onnx.ModelProto, values: _Values, rows: int, columns: int) -> _Known:
    """Compute all values and shapes that depend on the frame size alone, from known values."""
    sized = onnx.ModelProto()
    sized.CopyFrom(model)
    for value in sized.graph.input:
        dims = value.type.tensor_type.shape.dim
        dims[2].dim_value, dims[3].dim_value = rows, columns
    for value in sized.graph.output:
        value.type.tensor_type.ClearField("shape")
    while True:
        shapes = _inferred(sized)
        before = len(values)
        left = [node for node in sized.graph.node if not _compute(node, values, shapes, model)]
        if len(values) == before:
            return _Known(values, shapes)
        del sized.graph.node[:]
        sized.graph.node.extend(left)
        del sized.graph.initializer[:]
        sized.graph.initializer.extend(numpy_helper.from_array(v, n) for n, v in values.items())


def _compute(
    node: onnx.NodeProto, values: _Values, shapes: _Shapes, model: onnx.ModelProto
) -> bool:
    """Compute a node's outputs and add them to the values; return False if an input is unknown."""
    if values.keys() >= {*node.output}:  # a Constant
        return True
    inputs = [name for name in node.input if name]
    if node.op_type == "Shape" and inputs[0] in shapes and not node.attribute:
        values[node.output[0]] = np.array(shapes[inputs[0]], np.int64)
        return True
    if not inputs or any(name not in values for name in inputs):
        return False
    typed = [
        helper.make_tensor_value_info(
            name, helper.np_dtype_to_tensor_dtype(values[name].dtype), values[name].shape
        )
        for name in dict.fromkeys(inputs)
    ]
    results = [helper.make_empty_tensor_value_info(name) for name in node.output]
    one = helper.make_graph([node], "one node", typed, results)
    evaluator = ReferenceEvaluator(helper.make_model(one, opset_imports=model.opset_import))
    outputs = evaluator.run(None, {name: values[name] for name in inputs})
    values.update(zip(node.output, map(np.asarray, outputs), strict=True))
    return True


def _inferred(model: onnx.ModelProto) -> _Shapes:
    """Infer tensor shapes with ONNX; keep shapes whose sides are all numbers."""
    graph = onnx.shape_inference.infer_shapes(model, data_prop=True).graph
    shapes: _Shapes = {}
    for value in (*graph.value_info, *graph.input, *graph.output):
        tensor = value.type.tensor_type
        if tensor.HasField("shape") and all(d.HasField("dim_value") for d in tensor.shape.dim):
            shapes[value.name] = tuple(d.dim_value for d in tensor.shape.dim)
    return shapes


def _fix_ends(node: onnx.NodeProto, known: list[_Known], constants: _Values) -> None:
    """Count the ends of a Slice from the axis end, if that gives equal numbers for all sizes."""
    data, _, ends, axes = node.input[:4]
    if axes not in constants or any(data not in k.shapes or ends not in k.values for k in known):
        return
    along = constants[axes].tolist()
    sides = [np.array([k.shapes[data][axis] for axis in along]) for k in known]
    left = [np.minimum(k.values[ends] - side, 0) for k, side in zip(known, sides, strict=True)]
    if not all(np.array_equal(left[0], other) for other in left):
        return
    fixed = np.where(left[0] == 0, _ENDLESS, left[0]).astype(np.int64)
    name = f"end {' '.join(map(str, fixed))}"
    constants[name] = fixed
    node.input[2] = name


def _form(name: str, known: list[_Known]) -> list[int | str] | None:
    """Return a shape in which height and width are symbols; None if the shape is unknown."""
    if any(name not in k.shapes for k in known):
        return None
    form = [_side(axis) for axis in zip(*(k.shapes[name] for k in known), strict=True)]
    return None if None in form else [side for side in form if side is not None]


def _side(lengths: tuple[int, ...]) -> int | str | None:
    """Return a length, or a symbol such as rows_plus_2 for a length that depends on the frame."""
    if len(set(lengths)) == 1:
        return lengths[0]
    for word, frame in zip(("rows", "columns"), zip(*_SIZES, strict=True), strict=True):
        more = {length - side for length, side in zip(lengths, frame, strict=True)}
        if len(more) == 1:
            (extra,) = more
            return f"{word}_{'plus' if extra > 0 else 'less'}_{abs(extra)}" if extra else word
        shares = {side / length for length, side in zip(lengths, frame, strict=True)}
        if len(shares) == 1:
            return f"{word}_by_{shares.pop():g}"
    return None
