"""Exported networks: small ONNX files with PyTorch's results, which can be trained further."""

import io
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from torch import Tensor, nn

from glsim.cli import main
from glsim.core.errors import DenoiserError, TrainError
from glsim.denoise.inference import TorchNetwork
from glsim.denoise.registry import load_denoiser, shipped_file
from glsim.networks.inputs import DEPTH_ALONE
from glsim.networks.network import NetworkFunction
from glsim.networks.onnx_file import OnnxContent, OnnxRuntimeNetwork, OpenCvNetwork, read_onnx
from glsim.networks.record import DEFAULT_RECORD
from glsim.train.models.base import DepthModel, Prediction
from glsim.train.models.registry import build_model
from glsim.train.onnx_export import TOLERANCE_MM, export_onnx, onnx_bytes, weights_of_onnx
from glsim.train.onnx_graph import compacted
from glsim.train.recipe import load_recipe
from glsim.train.run_setup import read_start
from glsim.train.state import NOT_COPIED
from tests.support.networks import BACKBONES, frames, write_checkpoint


def test_the_shipped_network_needs_no_pytorch(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = frames(1, 64, 80)[0].numpy()
    for package in ("torch", "onnx", "onnxruntime", "glsim.denoise.inference"):
        monkeypatch.setitem(sys.modules, package, None)
    found = load_denoiser("face").estimate(frame)
    inner = np.s_[8:-8, 40:-8]
    measured = frame[0][inner][frame[0][inner] > 0]
    assert np.std(found.depth_mm[inner]) < 0.6 * np.std(measured)
    assert found.valid[inner].min() > 0.5


def test_the_command_writes_a_file_that_denoise_reads(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_checkpoint(Path("best.pt"), "paper", "dncnn")
    assert main(["export", "best.pt", "-o", "out/net.onnx"]) == 0
    assert "OpenCV gives PyTorch's depth within" in capsys.readouterr().err.replace("\n", " ")
    frame = frames(1, 40, 50)[0, 0].numpy()
    by_file, by_checkpoint = (load_denoiser(name)(frame) for name in ("out/net.onnx", "best.pt"))
    np.testing.assert_array_equal(by_file.valid, by_checkpoint.valid)
    np.testing.assert_allclose(by_file.depth_mm, by_checkpoint.depth_mm, atol=TOLERANCE_MM)
    assert main(["export", "best.pt", "-o", "net.pt"]) == 2
    assert "must end in .onnx or .safetensors" in capsys.readouterr().err


def test_a_network_that_returns_nan_is_refused() -> None:
    class Damaged(DepthModel):
        def forward(self, noisy_mm: torch.Tensor) -> Prediction:
            return Prediction(noisy_mm * torch.nan)

    frame = frames(1)[0].numpy()
    with pytest.raises(DenoiserError, match="weights are damaged"):
        NetworkFunction(TorchNetwork(Damaged()), "damaged.pt")(frame, frame > 0, 0)


def test_a_network_that_cannot_be_exported_or_differs_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "net.onnx"
    write_checkpoint(tmp_path / "best.pt", "paper", "restormer")
    with pytest.raises(TrainError, match="OpenCV cannot run this architecture"):
        export_onnx(tmp_path / "best.pt", out)
    write_checkpoint(tmp_path / "best.pt", "paper", "dncnn")
    monkeypatch.setattr("glsim.train.onnx_export.TOLERANCE_MM", -1.0)
    with pytest.raises(TrainError, match="not written"):
        export_onnx(tmp_path / "best.pt", out)
    assert not out.exists()


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


@pytest.mark.parametrize("runtime", [OpenCvNetwork, OnnxRuntimeNetwork])
def test_a_compacted_graph_gives_the_same_results(
    runtime: type[OpenCvNetwork | OnnxRuntimeNetwork], exported: bytes
) -> None:
    depth_mm = 900 + np.random.default_rng(0).normal(0, 3, (1, 48, 64)).astype(np.float32)
    content = OnnxContent(DEPTH_ALONE, DEFAULT_RECORD)
    before, after = (runtime(data, content)(depth_mm) for data in (exported, compacted(exported)))
    assert before["depth_mm"].std() > 0
    np.testing.assert_array_equal(after["depth_mm"], before["depth_mm"])


def test_constants_are_stored_once_and_shapes_are_written_down(exported: bytes) -> None:
    """Without shapes, onnxruntime loads in a time that grows with the square of the nodes."""
    data = compacted(exported)
    onnx.checker.check_model(data, full_check=True)
    assert len(data) < 0.6 * len(exported)
    graph = onnx.load_from_string(data).graph
    values = [(t.data_type, tuple(t.dims), t.raw_data) for t in graph.initializer]
    assert len(values) == len(set(values))
    operators = Counter(node.op_type for node in graph.node)
    computed = {"Constant", "Gather", "Unsqueeze", "Concat", "Reshape", "Cast"}
    assert not operators.keys() & computed
    assert operators["Slice"] == 30  # five of rows, five of columns of each
    shapes = {
        value.name: [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in graph.value_info
    }
    (padded,) = (node.output[0] for node in graph.node if node.op_type == "Pad")
    assert shapes[padded] == [1, 1, "rows_plus_4", "columns_plus_4"]
    slices = [shapes[node.output[0]] for node in graph.node if node.op_type == "Slice"]
    assert slices.count([1, 1, "rows", "columns"]) == 25
    assert compacted(data) == data


@pytest.mark.parametrize(
    "kind", ["paper_input", pytest.param("mask_aware", marks=pytest.mark.long)]
)
def test_a_network_is_its_onnx_file_again(kind: str, tmp_path: Path) -> None:
    torch.manual_seed(3)
    spec = {"kind": kind, "backbone": BACKBONES["small_unet"]}
    model = build_model(spec).eval()
    with torch.no_grad():  # before training many are 0, and the exporter keeps equal tensors once
        for value in model.parameters():
            value.normal_()
    file = tmp_path / "network.onnx"
    file.write_bytes(onnx_bytes(model, file))
    found = weights_of_onnx(file, spec)
    assert model.state_dict().keys() - found.keys() <= set(NOT_COPIED)
    for name, weight in found.items():
        torch.testing.assert_close(weight, model.state_dict()[name], rtol=0, atol=0, msg=name)


@pytest.mark.long
@pytest.mark.parametrize("name", ["face", "face-video"])
def test_each_shipped_network_can_be_trained_further(name: str) -> None:
    chosen = load_recipe(name, (), {"training": {"start": name}})
    weights, record = read_start(name, chosen.model)
    model = build_model(chosen.model).eval()
    model.load_state_dict(dict(weights.values))
    stack = frames(1, 64, 80).repeat(1, model.inputs.channels, 1, 1)
    stack[:, 1:] += 2.0 * torch.arange(1, model.inputs.channels).view(1, -1, 1, 1)
    path = shipped_file(name)
    denoised = OpenCvNetwork(*read_onnx(path))(stack[0].numpy())
    with torch.inference_mode():
        depth_mm = model(stack).depth_mm[0, 0].numpy()
    assert abs(depth_mm - denoised["depth_mm"]).max() < 0.01
    assert (record["file"], len(record["crc32"])) == (name, 8)


def test_weights_that_a_training_cannot_start_from(tmp_path: Path) -> None:
    with pytest.raises(TrainError, match=r"fase: no such checkpoint: .* shipped network \(face,"):
        read_start("fase", load_recipe("face").model)
    path = shipped_file("face")
    with pytest.raises(TrainError, match="another architecture"):
        weights_of_onnx(path, {"kind": "paper_input", "backbone": BACKBONES["dncnn"]})
    (tmp_path / "cut.onnx").write_bytes(path.read_bytes()[:4000])
    with pytest.raises(TrainError, match=r"cut\.onnx: is damaged"):
        weights_of_onnx(tmp_path / "cut.onnx", load_recipe("face").model)
    spec = {"kind": "paper_input", "backbone": BACKBONES["unet"]}
    file = tmp_path / "unet.onnx"
    file.write_bytes(onnx_bytes(build_model(spec).eval(), file))
    with pytest.raises(TrainError, match=r"ONNX files do not keep .* start from a checkpoint"):
        weights_of_onnx(file, spec)
