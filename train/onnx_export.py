"""Export of a checkpoint's network to ONNX, which runs without PyTorch, and its reading."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glsim.core.errors import DenoiserError, TrainError
from glsim.core.files.atomic import write_atomic
from glsim.denoise.inference import TorchNetwork, load_model
from glsim.networks.inputs import NetworkInputs, stack_inputs
from glsim.networks.onnx_file import OpenCvNetwork, read_content, read_onnx, record_entries
from glsim.networks.record import DEFAULT_RECORD, NetworkRecord
from glsim.train.models.base import DepthModel, NamedOutputs, named_outputs
from glsim.train.models.registry import build_model
from glsim.train.state import NOT_COPIED

#: Largest difference of an exported network from PyTorch, mm. Chosen: 1/100 step of a depth file.
TOLERANCE_MM: Final = 0.01
#: Version of the ONNX operators: OpenCV 5, onnxruntime and onnxruntime-web read it.
_OPSET: Final = 17


def export_onnx(checkpoint: Path, out: Path) -> dict[str, float]:
    """Write a checkpoint's network to an ONNX file, after a check of OpenCV against PyTorch.

    The graph maps ``noisy_mm``, (1, 1, H, W) float32 millimetres with 0 = no return, to the outputs
    of ``glsim.train.models.base``, of the same shape. Further inputs are named as in
    ``glsim.networks.inputs``: (1, images, H, W), zeros for missing images. H and W must be
    multiples of 16 (pad with zeros).

    Returns output name -> largest difference between OpenCV and PyTorch on two test frames. Raises
    DenoiserError for a damaged or foreign checkpoint, TrainError if the network cannot be exported
    or run by OpenCV (Restormer), or results differ.
    """
    model, record = load_model(checkpoint)
    data = onnx_bytes(model.cpu().eval(), checkpoint, record)
    differences = _compare(TorchNetwork(model), data, checkpoint)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(data, out)
    return differences


def onnx_bytes(
    model: DepthModel, checkpoint: Path, record: NetworkRecord = DEFAULT_RECORD
) -> bytes:
    """Export a model to the bytes of an ONNX file, unchecked; errors name ``checkpoint``.

    Uses PyTorch's TorchScript exporter: the newer one is forty times slower for `MaskAware`.
    """
    example = torch.from_numpy(_test_stack(model.inputs, 80, 96))[None]
    inputs = model.inputs.named(example)
    with torch.inference_mode():
        names = list(named_outputs(model(example)))
    buffer = io.BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # it warns of sizes that dynamic_axes makes variable
        # The exporter lacks Asinh, which onnxruntime would compute element by element.
        torch.onnx.register_custom_op_symbolic(  # type: ignore[attr-defined]  # it is documented
            "aten::asinh", _asinh, _OPSET
        )
        try:
            torch.onnx.export(
                NamedOutputs(model),
                tuple(inputs.values()),
                buffer,  # type: ignore[arg-type]  # dynamo=False takes a file, too
                input_names=[*inputs],
                output_names=names,
                dynamic_axes={name: {2: "rows", 3: "columns"} for name in (*inputs, *names)},
                opset_version=_OPSET,
                dynamo=False,
            )
        except torch.onnx.errors.OnnxExporterError as error:
            raise TrainError(f"{checkpoint}: this network cannot be exported: {error}") from error
        except RuntimeError as error:
            reason = " ".join(str(error).split())[:200]
            raise TrainError(f"{checkpoint}: this network cannot be exported: {reason}") from error
    from glsim.train.onnx_graph import compacted  # PyTorch has just used the package onnx

    return compacted(buffer.getvalue(), record_entries(record))


def _asinh(graph: Any, x: Any) -> Any:
    """Write asinh x = sgn x log(|x| + sqrt(x^2 + 1)) into a graph."""
    one = graph.op("Constant", value_t=torch.ones(()))
    root = graph.op("Sqrt", graph.op("Add", graph.op("Mul", x, x), one))
    size = graph.op("Log", graph.op("Add", graph.op("Abs", x), root))
    return graph.op("Mul", graph.op("Sign", x), size)


def _test_stack(inputs: NetworkInputs, height: int, width: int) -> NDArray[np.float32]:
    """Create test inputs of a frame, (C, height, width); neighbours have other noise."""
    seeds = range(1 + inputs.before + inputs.after)
    frame, *others = (_test_frame(height, width, seed) for seed in seeds)
    return stack_inputs(inputs, frame, others[: inputs.before], others[inputs.before :])


def _test_frame(height: int, width: int, seed: int) -> NDArray[np.float32]:
    """Create a test frame, (height, width) float32 mm: noisy surface, depth step and holes."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width]
    depth_mm = 900 + 0.4 * columns + rng.normal(0, 1.6, rows.shape)
    depth_mm[:, 60:] += 300.0
    depth_mm[(rng.random(rows.shape) < 0.02) | (rows < 6) | ((columns > 56) & (columns < 62))] = 0
    return np.asarray(depth_mm, np.float32)


def _compare(network: TorchNetwork, data: bytes, checkpoint: Path) -> dict[str, float]:
    """Compute the largest difference of each output between OpenCV and PyTorch, for two sizes."""
    try:
        content = read_content(data)
    except ValueError as error:
        raise TrainError(f"{checkpoint}: its network {error}, which no reader accepts") from None
    exported = OpenCvNetwork(data, content)
    differences: dict[str, float] = {}
    for frame in (_test_stack(exported.inputs, *size) for size in ((80, 96), (128, 112))):
        try:
            outputs = exported(frame)
        except cv2.error as error:
            raise TrainError(
                f"{checkpoint}: OpenCV cannot run this architecture ({error.err}): use the "
                "checkpoint, with PyTorch"
            ) from None
        for name, image in network(frame).items():
            off = float(np.abs(outputs[name] - image).max())
            differences[name] = max(off, differences.get(name, 0.0))
    if not differences["depth_mm"] <= TOLERANCE_MM:
        raise TrainError(
            f"{checkpoint}: the exported network differs by {differences['depth_mm']:.3g} mm from "
            "PyTorch: not written"
        )
    return differences


def weights_of_onnx(path: Path, spec: Mapping[str, Any]) -> dict[str, Tensor]:
    """Read the weights from an ONNX file of ``glsim export``, by their names in PyTorch.

    The file does not name its weights. A network of ``spec`` is therefore filled with random
    numbers and exported: equal numbers show the position of each weight in the file. Returns name
    -> weight, for the inputs of the file; without the unused buffers of `NOT_COPIED`. Raises
    TrainError: a damaged file, another architecture, or weights with batch normalisation.
    """
    try:
        data, content = read_onnx(path)
    except DenoiserError as error:
        raise TrainError(str(error)) from None
    seen = {n: value for n, value in content.inputs._asdict().items() if value or n in spec}
    model = build_model({**spec, **seen}).eval()
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for value in model.state_dict().values():
            if value.is_floating_point():
                # In [0.5, 0.6]: the exporter folds constants such as 0 and 1.
                value.copy_(0.5 + 0.1 * torch.rand(value.shape, generator=generator))
    example, stored = _tensors(onnx_bytes(model, path)), _tensors(data)
    if [value.shape for value in stored] != [value.shape for value in example]:
        raise TrainError(
            f"{path}: is another architecture, or was exported by another version of glsim: start "
            "from a network with the same [model], from its checkpoint, or without --from"
        )
    by_tag = {tag.numpy().tobytes(): value for tag, value in zip(example, stored, strict=True)}
    weights = {}
    for name, value in model.state_dict().items():
        weight = by_tag.get(value.contiguous().numpy().tobytes())
        if weight is not None:
            weights[name] = weight.reshape(value.shape)  # a bias may have become (1, C, 1, 1)
        elif name not in NOT_COPIED:
            raise TrainError(
                f"{path}: ONNX files do not keep {name} of this architecture: start from a "
                "checkpoint (best.pt)"
            )
    return weights


def _tensors(data: bytes) -> list[Tensor]:
    import onnx

    tensors = onnx.load_from_string(data).graph.initializer
    arrays = [onnx.numpy_helper.to_array(tensor) for tensor in tensors]
    return [torch.from_numpy(array.copy()) for array in arrays if array.dtype.kind == "f"]
