"""Read the network of an ONNX file, and run it by onnxruntime or, without it, by OpenCV.

Each input of ``glsim.networks.inputs`` is a named input of the graph, (1, images, H, W) float32; H
and W are multiples of SIZE_MULTIPLE_PX. Load only networks that you trust: a file is bounded in
size, may use the operators of convolutional networks alone and no other file, and must run on a
small frame of zeros, but how much memory and time a larger frame takes is the network's choice.

Sizes and settings are read from the file itself (Protocol Buffers; numbers of fields as in
onnx.proto of ONNX 1.17), since OpenCV does not tell them and the package onnx need not be there.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import cv2
import numpy as np

from glsim.core.array_types import Depth
from glsim.core.depth_protocol import check_protocol
from glsim.core.errors import ConfigError, DenoiserError
from glsim.core.files.regular import read_regular
from glsim.networks.inputs import AFTER, BEFORE, DEPTH, NetworkInputs
from glsim.networks.network import NetworkFunction, Runner
from glsim.networks.record import DEFAULT_RECORD, NetworkRecord

Runtime = Literal["onnxruntime", "opencv"]

#: Largest file, bytes: four times the float32 weights of the largest recipe (Restormer: 26 million)
_MAX_BYTES: Final = 2**29
#: Side of the frame of zeros that a network must run on, px.
_TRIAL_PX: Final = 32
#: Accepted operators: those that ``glsim export`` writes, and further operators of convolutional
#: networks. Others could run for ever (Loop, Scan) or run other code.
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
_OPERATORS: Final = frozenset(_OPERATOR_NAMES.encode().split())
#: Prefix of a record's keys in the file, before the names of its fields; defaults have no entry.
_PREFIX: Final = "glsim."

# Numbers of fields: ModelProto, GraphProto, NodeProto, AttributeProto, TensorProto.
_GRAPH, _METADATA = 7, 14
_NODE, _INITIALIZER, _INPUT = 1, 5, 11
_OPERATOR, _ATTRIBUTE, _DOMAIN = 4, 5, 7
_TENSOR, _EXTERNAL = 5, 13
#: Wire type -> bytes of a number of fixed length.
_LENGTHS: Final = {1: 8, 5: 4}
#: ValueInfoProto.name and .type, and the way from a type to the sides of its shape.
_NAME, _TYPE, _TO_SIDES, _SIDE = 1, 2, (1, 2, 1), 1


class OnnxContent(NamedTuple):
    """The inputs and the record of a network in an ONNX file."""

    inputs: NetworkInputs
    record: NetworkRecord


def read_onnx(path: Path) -> tuple[bytes, OnnxContent]:
    """Read and check a file of ``glsim export`` without running it. Raises DenoiserError."""
    try:
        data = read_regular(path, _MAX_BYTES)
    except OSError as error:
        raise DenoiserError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        return data, read_content(data)
    except (ValueError, ConfigError) as error:
        reason = f"it {error}"
    except (IndexError, TypeError):  # the bytes are no message
        reason = "it is cut short"
    raise DenoiserError(f"{path}: is damaged, or is no network of glsim export ({reason})")


def load_onnx(
    path: Path, min_probability: float = 0.0, runtime: Runtime | None = None
) -> NetworkFunction:
    """Load the network of a file of ``glsim export`` as a denoising function.

    The default runtime is onnxruntime if it is installed, else opencv. Raises DenoiserError as
    ``read_onnx``, and for a network that does not run on a frame of zeros.
    """
    data, content = read_onnx(path)
    try:
        network = run_onnx(data, content, runtime)
        outputs = network(np.zeros((content.inputs.channels, _TRIAL_PX, _TRIAL_PX), np.float32))
        if any(image.shape != (_TRIAL_PX, _TRIAL_PX) for image in outputs.values()):
            raise ValueError("its outputs are not of the size of the frame")
    except Exception as error:  # both runtimes have their own classes of errors
        reason = " ".join(str(error).split())
        raise DenoiserError(f"{path}: is damaged, or is no ONNX network ({reason:.200})") from None
    if "depth_mm" not in outputs:
        found = ", ".join(outputs)
        raise DenoiserError(f"{path}: has no output 'depth_mm' (but {found}): see glsim export")
    return NetworkFunction(network, str(path), min_probability)


def run_onnx(data: bytes, content: OnnxContent, runtime: Runtime | None = None) -> Runner:
    """Make the runner of a network in the bytes of an ONNX file. Raises the runtime's errors."""
    if runtime != "opencv":
        try:
            return OnnxRuntimeNetwork(data, content)
        except ImportError:
            if runtime is not None:
                raise
    return OpenCvNetwork(data, content)


class OpenCvNetwork:
    """A ``Runner`` by OpenCV, whose new engine (OpenCV 5) accepts frames of any size."""

    def __init__(self, data: bytes, content: OnnxContent) -> None:
        self.inputs, self.record = content
        graph = np.frombuffer(data, np.uint8)
        self._net = cv2.dnn.readNetFromONNX(graph, engine=cv2.dnn.ENGINE_NEW)
        self.outputs = tuple(self._net.getUnconnectedOutLayersNames())

    def __call__(self, stack: Depth) -> Mapping[str, Depth]:
        """Run the network on a stack of inputs, (C, H, W)."""
        for name, blob in _blobs(self.inputs, stack).items():
            self._net.setInput(blob, name)
        # By several threads OpenCV 5.0.0 returns NaN from 360,448 px on. Measured: right to the bit
        # up to 358,400 px with 2 to 32 threads, and for any size with one.
        threads = cv2.getNumThreads()
        cv2.setNumThreads(1 if stack[0].size > 350_000 else threads)
        images = self._net.forward(self.outputs)
        cv2.setNumThreads(threads)
        return {name: image[0, 0] for name, image in zip(self.outputs, images, strict=True)}


class OnnxRuntimeNetwork:
    """A ``Runner`` by onnxruntime, with as many threads as OpenCV uses."""

    def __init__(self, data: bytes, content: OnnxContent) -> None:
        # From 1.29 its library reports to its vendor from the moment of the import on Linux and
        # macOS (onnxruntime, pull request 27379); a user who wants that sets the variable to 0.
        os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
        import onnxruntime

        self.inputs, self.record = content
        onnxruntime.disable_telemetry_events()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = cv2.getNumThreads()
        # Threads that spin for work starve each other where other programs run. Measured, a head in
        # a stream on two cores: 49 instead of 45 ms alone, 59 instead of 111 ms with one core busy.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3  # errors; warnings would go to stderr
        on_cpu = ["CPUExecutionProvider"]
        self._session = onnxruntime.InferenceSession(data, options, providers=on_cpu)
        self.outputs = tuple(output.name for output in self._session.get_outputs())

    def __call__(self, stack: Depth) -> Mapping[str, Depth]:
        """Run the network on a stack of inputs, (C, H, W)."""
        images = self._session.run(self.outputs, _blobs(self.inputs, stack))
        return {name: image[0, 0] for name, image in zip(self.outputs, images, strict=True)}


def _blobs(inputs: NetworkInputs, stack: Depth) -> dict[str, Depth]:
    """Split a stack into the inputs of a graph: name -> (1, images, H, W)."""
    return {name: np.ascontiguousarray(part[None]) for name, part in inputs.named(stack).items()}


def read_content(data: bytes) -> OnnxContent:
    """Check the operators of an ONNX file; return the inputs and the record of its network.

    Raises ValueError or ConfigError, with the reason, for a file that ``glsim export`` cannot have
    written; IndexError or TypeError for bytes that are no message.
    """
    graphs = list(_messages(memoryview(data), _GRAPH))
    if len(graphs) != 1:
        raise ValueError("holds several graphs" if graphs else "holds no graph")
    counts: dict[str, int] = {}
    for number, part in _fields(graphs[0]):
        if number == _NODE:
            _check_node(part)
        elif number == _INITIALIZER:
            _check_tensor(part)
        elif number == _INPUT:
            counts[_text(part, _NAME)] = _images(part)
    if counts.get(DEPTH) != 1 or counts.keys() - {DEPTH, BEFORE, AFTER}:
        raise ValueError(f"has the inputs {', '.join(map(repr, counts)) or 'none'}")
    inputs = NetworkInputs(counts.get(BEFORE, 0), counts.get(AFTER, 0))
    entries = _messages(memoryview(data), _METADATA)
    return OnnxContent(inputs, _record({_text(entry, 1): _text(entry, 2) for entry in entries}))


def _record(text: Mapping[str, str]) -> NetworkRecord:
    """Parse the record of a network from text. Raises ValueError for a value out of range."""
    known = DEFAULT_RECORD._asdict().items()
    given = {name: text.get(f"{_PREFIX}{name}", default) for name, default in known}
    protocol = check_protocol(str(given["protocol"]), "protocol")
    assert protocol is not None
    record = NetworkRecord(protocol, bool(int(given["keep_clean"])), int(given["margin_px"]))
    if record.margin_px < DEFAULT_RECORD.margin_px:
        raise ValueError(f"has the settings {', '.join(f'{k}={v}' for k, v in text.items()):.60}")
    return record


def record_entries(record: NetworkRecord) -> dict[str, str]:
    """Return the metadata of a network's file, key -> text; default values are left out."""
    return {
        f"{_PREFIX}{name}": value if isinstance(value, str) else f"{value:g}"
        for name, default in DEFAULT_RECORD._asdict().items()
        if (value := getattr(record, name)) != default
    }


def _check_node(node: memoryview) -> None:
    name = domain = b""
    for number, content in _fields(node):
        if number == _OPERATOR:
            name = bytes(content)
        elif number == _DOMAIN:
            domain = bytes(content)
        elif number == _ATTRIBUTE:
            for tensor in _messages(content, _TENSOR):
                _check_tensor(tensor)
    operator = b"%b %b" % (domain, name) if domain else name
    if operator not in _OPERATORS:
        raise ValueError(f"uses the operator {operator.decode(errors='replace')!a:.60}")


def _check_tensor(tensor: memoryview) -> None:
    if any(number == _EXTERNAL for number, _ in _fields(tensor)):
        raise ValueError("keeps weights in another file")


def _images(value: memoryview) -> int:
    """Return the number of images of an input, which is the second side of its shape."""
    messages = list(_messages(value, _TYPE))
    for number in _TO_SIDES:
        messages = [inner for message in messages for inner in _messages(message, number)]
    return next((n for n in _messages(messages[1], _SIDE)), 0) if len(messages) > 1 else 0


def _text(message: memoryview, number: int) -> str:
    return bytes(next(_messages(message, number), b"")).decode("utf-8", "replace")


def _messages(message: memoryview, number: int) -> Iterator[Any]:
    return (content for found, content in _fields(message) if found == number)


def _fields(message: memoryview) -> Iterator[tuple[int, Any]]:
    """Yield a message's fields; ValueError if it is none, IndexError if it is cut short."""
    at, end = 0, len(message)
    while at < end:
        key, at = _varint(message, at)
        kind = key & 7
        if kind == 0:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        length, at = _varint(message, at) if kind == 2 else (_LENGTHS.get(kind, end), at)
        if key < 8 or at + length > end:
            raise ValueError("is damaged or cut short")
        yield key >> 3, message[at : at + length]
        at += length


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """Decode a protobuf integer of 7 bits per byte; return it and the position after it."""
    if message[at] < 128:
        return message[at], at + 1
    value = 0
    for shift in range(0, 70, 7):
        value |= (message[at] & 127) << shift
        at += 1
        if message[at - 1] < 128:
            return value, at
    raise ValueError("is damaged")
