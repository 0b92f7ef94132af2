"""Weights are read back from ONNX files, so that shipped networks can be trained further."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from glsim.denoise.loading import shipped_file
from glsim.denoise.onnx_file import OpenCvNetwork
from glsim.errors import TrainError
from glsim.train.models.registry import build_model, weight_shapes
from glsim.train.models.warm_start import NOT_COPIED
from glsim.train.onnx_export import onnx_bytes
from glsim.train.onnx_weights import weights_of_onnx
from glsim.train.recipe import load_recipe
from glsim.train.run_setup import start_record, start_weights
from tests.support.networks import BACKBONES, frames


@pytest.mark.parametrize(
    "kind", ["paper_input", "masked_depth", pytest.param("mask_aware", marks=pytest.mark.long)]
)
@pytest.mark.parametrize("backbone", sorted(BACKBONES.keys() - {"unet", "restormer"}))
def test_a_network_is_its_onnx_file_again(kind: str, backbone: str, tmp_path: Path) -> None:
    torch.manual_seed(3)
    spec = {"kind": kind, "backbone": BACKBONES[backbone]}
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


@pytest.mark.parametrize(
    "name",
    ["face", "face-live", "face-stereo", pytest.param("face-video", marks=pytest.mark.long)],
)
def test_each_shipped_network_can_be_trained_further(name: str) -> None:
    chosen = load_recipe(name, (), {"training": {"start": name}})
    weights = start_weights(chosen)
    assert weights is not None
    shapes = {key: tuple(value.shape) for key, value in weights.values.items()}
    assert shapes == weight_shapes(chosen.model)
    model = build_model(chosen.model).eval()
    model.load_state_dict(dict(weights.values))
    stack = frames(1, 64, 80).repeat(1, model.inputs.channels, 1, 1)
    stack[:, 1:] += 2.0 * torch.arange(1, model.inputs.channels).view(1, -1, 1, 1)
    with shipped_file(name) as path:
        denoised = OpenCvNetwork(path.read_bytes())(stack[0].numpy())
    with torch.inference_mode():
        depth_mm = model(stack).depth_mm[0, 0].numpy()
    assert abs(depth_mm - denoised["depth_mm"]).max() < 0.01
    record = start_record(chosen)
    assert record is not None
    assert record["file"] == name
    assert len(record["crc32"]) == 8


@pytest.mark.long
def test_a_network_with_more_inputs_starts_from_the_shipped_one_of_single_frames() -> None:
    spec = load_recipe("face-video").model
    with shipped_file("face") as path:
        weights = weights_of_onnx(path, spec)
    assert {name: tuple(value.shape) for name, value in weights.items()} == weight_shapes(
        {**spec, "before": 0}
    )


def test_neither_a_file_nor_a_shipped_network() -> None:
    with pytest.raises(TrainError, match=r"fase: no such checkpoint: .* shipped network \(face,"):
        start_weights(load_recipe("face", (), {"training": {"start": "fase"}}))


def test_a_file_of_another_architecture_is_refused() -> None:
    with shipped_file("face") as path, pytest.raises(TrainError, match="another architecture"):
        weights_of_onnx(path, {"kind": "paper_input", "backbone": BACKBONES["dncnn"]})


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "cut.onnx"
    with shipped_file("face") as path:
        file.write_bytes(path.read_bytes()[:4000])
    with pytest.raises(TrainError, match=r"cut\.onnx: is damaged"):
        weights_of_onnx(file, load_recipe("face").model)


def test_weights_that_the_exporter_merged_are_refused(tmp_path: Path) -> None:
    spec = {"kind": "paper_input", "backbone": BACKBONES["unet"]}
    file = tmp_path / "unet.onnx"
    file.write_bytes(onnx_bytes(build_model(spec).eval(), file))
    with pytest.raises(TrainError, match=r"ONNX files do not keep .* start from a checkpoint"):
        weights_of_onnx(file, spec)
