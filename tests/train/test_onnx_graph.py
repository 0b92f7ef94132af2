"""Test that a compacted ONNX graph is smaller and gives bit-identical results."""

from __future__ import annotations

import io
import subprocess
import sys
import warnings
from collections import Counter

import numpy as np
import onnx
import pytest
import torch
from torch import Tensor, nn

from glsim.denoise.loading import shipped_file
from glsim.denoise.onnx_file import OnnxRuntimeNetwork, OpenCvNetwork
from glsim.train.onnx_graph import compacted
from glsim.train.onnx_shapes import with_shapes


class _Slices(nn.Module):
    """Average 25 shifted copies of an image: each is exported as a Slice with its own constants."""

    def __init__(self) -> None:
        super().__init__()
        self.smooth = nn.Conv2d(1, 1, 3, padding=1)

    def forward(self, noisy_mm: Tensor) -> Tensor:
        around = nn.functional.pad(noisy_mm, (2, 2, 2, 2))
        height, width = noisy_mm.shape[-2:]
        total = torch.zeros_like(noisy_mm)
        for down in range(5):
            for right in range(5):
                total = total + around[..., down : down + height, right : right + width]
        smooth: Tensor = self.smooth(total / 25)
        return smooth


@pytest.fixture(scope="module")
def exported() -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the newer exporter, see glsim.train.onnx_export
        torch.onnx.export(
            _Slices(),
            (torch.rand(1, 1, 32, 32),),
            buffer,  # type: ignore[arg-type]  # as in glsim.train.onnx_export
            input_names=["noisy_mm"],
            output_names=["depth_mm"],
            dynamic_axes={name: {2: "rows", 3: "columns"} for name in ("noisy_mm", "depth_mm")},
            opset_version=17,
            dynamo=False,
        )
    return buffer.getvalue()


def test_each_constant_is_stored_once_under_a_short_name(exported: bytes) -> None:
    before, after = (onnx.load_from_string(d).graph for d in (exported, compacted(exported)))
    assert sum(node.op_type == "Constant" for node in before.node) > 50
    assert not [node for node in after.node if node.op_type == "Constant" or node.name]
    values = [(t.data_type, tuple(t.dims), t.raw_data) for t in after.initializer]
    assert len(values) == len(set(values))
    names = [name for node in after.node for name in (*node.input, *node.output)]
    assert max(len(name) for name in names if name not in ("noisy_mm", "depth_mm")) <= 4
    assert len(compacted(exported)) < 0.6 * len(exported)
    onnx.checker.check_model(compacted(exported), full_check=True)


@pytest.mark.parametrize("runtime", [OpenCvNetwork, OnnxRuntimeNetwork])
def test_the_results_are_the_same(
    runtime: type[OpenCvNetwork | OnnxRuntimeNetwork], exported: bytes
) -> None:
    depth_mm = 900 + np.random.default_rng(0).normal(0, 3, (48, 64)).astype(np.float32)
    before, after = runtime(exported)(depth_mm), runtime(compacted(exported))(depth_mm)
    assert before["depth_mm"].std() > 0
    np.testing.assert_array_equal(after["depth_mm"], before["depth_mm"])


def test_sizes_are_not_computed_in_the_graph_and_shapes_are_written_down(exported: bytes) -> None:
    """Without shapes, onnxruntime loads in a time that grows with the square of the nodes."""
    graph = onnx.load_from_string(compacted(exported)).graph
    operators = Counter(node.op_type for node in graph.node)
    assert not operators.keys() & {"Gather", "Unsqueeze", "Concat", "Reshape", "Cast"}
    assert operators["Slice"] == 30  # five of rows, five of columns of each
    assert len(graph.node) < 0.5 * len(onnx.load_from_string(exported).graph.node)
    shapes = {
        value.name: [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in graph.value_info
    }
    (padded,) = (node.output[0] for node in graph.node if node.op_type == "Pad")
    assert shapes[padded] == [1, 1, "rows_plus_4", "columns_plus_4"]
    slices = [shapes[node.output[0]] for node in graph.node if node.op_type == "Slice"]
    assert slices.count([1, 1, "rows", "columns_plus_4"]) == 5
    assert slices.count([1, 1, "rows", "columns"]) == 25


def test_it_can_be_done_again(exported: bytes) -> None:
    once = with_shapes(onnx.load_from_string(compacted(exported)))
    again = with_shapes(once)
    assert again.SerializeToString() == once.SerializeToString()


@pytest.mark.parametrize(
    ("name", "least_slices"),
    [("face", 200), ("face-live", 100), ("face-stereo", 200), ("face-video", 200)],
)
def test_the_shipped_networks_have_shapes(name: str, least_slices: int) -> None:
    with shipped_file(name) as path:
        graph = onnx.load(path).graph
    known = {value.name for value in graph.value_info}
    slices = [node.output[0] for node in graph.node if node.op_type == "Slice"]
    assert len(slices) > least_slices
    assert len(known.intersection(slices)) > 0.98 * len(slices)


@pytest.mark.parametrize("name", ["face", "face-live", "face-stereo", "face-video"])
def test_the_shapes_hold_for_other_sizes(name: str) -> None:
    """Onnxruntime warns where the shape of a result is not the one that was written down."""
    script = (
        "import sys, numpy as np, onnxruntime\n"
        "options = onnxruntime.SessionOptions()\n"
        "options.log_severity_level = 2\n"
        "network = onnxruntime.InferenceSession(sys.argv[1], options)\n"
        "for size in ((16, 16), (112, 80), (176, 192)):\n"
        "    network.run(None, {i.name: np.full((1, i.shape[1], *size), 900, np.float32)\n"
        "                       for i in network.get_inputs()})\n"
    )
    with shipped_file(name) as path:
        done = subprocess.run(
            [sys.executable, "-c", script, path], capture_output=True, text=True, check=False
        )
    assert done.returncode == 0, done.stderr
    assert "shape" not in done.stderr, done.stderr
