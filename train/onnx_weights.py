"""Read the weights of a network back from its ONNX file, to train it further."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from glsim.denoise.onnx_file import read_onnx
from glsim.denoise.onnx_inputs import read_inputs
from glsim.errors import DenoiserError, TrainError
from glsim.train.models.registry import build_model
from glsim.train.models.warm_start import NOT_COPIED
from glsim.train.onnx_export import onnx_bytes


def weights_of_onnx(path: Path, spec: Mapping[str, Any]) -> dict[str, Tensor]:
    """Read the weights of a file of ``glsim export``, by their names in PyTorch.

    The file does not name its weights. A network of ``spec`` is therefore filled with random
    numbers and exported: the tensor that holds the numbers of a weight shows its place in the file.

    Args:
        path: the ONNX file. It may have fewer inputs than ``spec``: the result has those inputs.
        spec: the [model] table of a recipe.

    Returns:
        Name -> weight; without the buffers of `NOT_COPIED` that the graph does not use.

    Raises:
        TrainError: for a damaged file, another architecture, or weights that the exporter merged
            (batch normalisation).
    """
    try:
        data = read_onnx(path)
        inputs = read_inputs(data)
    except (DenoiserError, ValueError) as error:
        raise TrainError(str(error)) from None
    seen = {name: value for name, value in inputs._asdict().items() if value or name in spec}
    model = build_model({**spec, **seen}).eval()
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for value in model.state_dict().values():
            if value.is_floating_point():
                # In [0.5, 0.6]: the exporter folds constants such as 0 and 1.
                value.copy_(0.5 + 0.1 * torch.rand(value.shape, generator=generator))
    example = _tensors(onnx_bytes(model, path))
    found = _tensors(data)
    if [value.shape for value in found] != [value.shape for value in example]:
        raise TrainError(
            f"{path}: is another architecture, or was exported by another version of glsim: start "
            "from a network with the same [model], from its checkpoint, or without --from"
        )
    places = {tag.numpy().tobytes(): value for tag, value in zip(example, found, strict=True)}
    weights = {}
    for name, value in model.state_dict().items():
        place = places.get(value.contiguous().numpy().tobytes())
        if place is not None:
            weights[name] = place.reshape(value.shape)  # a bias may have become (1, C, 1, 1)
        elif name not in NOT_COPIED:
            raise TrainError(
                f"{path}: ONNX files do not keep {name} of this architecture: start from a "
                "checkpoint (best.pt)"
            )
    return weights


def _tensors(data: bytes) -> list[Tensor]:
    """Return the constant float tensors of an ONNX graph, in the order of the file."""
    import onnx

    tensors = onnx.load_from_string(data).graph.initializer
    arrays = [onnx.numpy_helper.to_array(tensor) for tensor in tensors]
    return [torch.from_numpy(array.copy()) for array in arrays if array.dtype.kind == "f"]
