"""Test that a compacted ONNX graph is smaller and gives bit-identical results."""

from __future__ import annotations

import io
import warnings

import numpy as np
import onnx
import pytest
import torch
from torch import Tensor, nn

from glsim.denoise.onnx_file import OnnxRuntimeNetwork, OpenCvNetwork
from glsim.train.onnx_graph import compacted


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
