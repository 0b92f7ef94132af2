"""Checkpoint, safetensors and ONNX file of a network hold the same settings of its denoiser."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from glsim.core.errors import DenoiserError
from glsim.denoise.registry import load_denoiser, shipped_file
from glsim.networks import checkpoint
from glsim.networks.onnx_file import load_onnx, read_onnx, record_entries
from glsim.networks.record import NetworkRecord
from glsim.train.models.registry import build_model
from glsim.train.onnx_export import export_onnx

RECORD = NetworkRecord(protocol="paper", keep_clean=False, margin_px=80)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a checkpoint whose settings all differ from the defaults."""
    table = {"kind": "mask_aware", "keep_clean": False}
    table |= {"backbone": {"kind": "small_unet", "width": 4, "scales": 5, "growth": 0.0}}
    content: dict[str, Any] = {"recipe": {"model": table}, "model": build_model(table).state_dict()}
    content |= {"progress": {}, "validation": {}, "data": {"protocol": "paper"}}
    path = tmp_path_factory.mktemp("run") / "best.pt"
    checkpoint.save(path, content)
    return path


@pytest.mark.parametrize("suffix", [".pt", ".safetensors", ".onnx"])
@pytest.mark.long
def test_every_file_of_a_network_has_its_record(trained: Path, suffix: str) -> None:
    path = trained.with_suffix(suffix)
    if suffix == ".onnx":
        export_onnx(trained, path)
    elif suffix == ".safetensors":
        checkpoint.export_safetensors(trained, path)
    network: Any = load_denoiser(str(path)).function
    found = (network.protocol, network.keep_clean, network.margin_px)
    assert found == RECORD
    plane = np.full((1, 64, 64), 800, np.float32)
    for option, kept in (("", False), (":keep_clean=0", False), (":keep_clean=1", True)):
        denoiser: Any = load_denoiser(f"{path}{option}")
        assert denoiser.function.keep_clean == kept
        assert np.array_equal(denoiser.estimate(plane).depth_mm, plane[0]) or not kept


@pytest.mark.parametrize(("scales", "margin_px"), [(2, 48), (4, 48), (5, 80), (6, 144)])
def test_a_network_of_more_scales_sees_farther(scales: int, margin_px: int) -> None:
    small = {"kind": "small_unet", "width": 4, "scales": scales}
    assert build_model({"kind": "mask_aware", "backbone": small}).margin_px == margin_px


def test_the_shipped_networks_and_files_without_a_record() -> None:
    for name, record in (
        ("face", NetworkRecord()),
        ("face-azure-kinect", NetworkRecord()),
        ("face-stereo", NetworkRecord(keep_clean=False, margin_px=80)),
    ):
        path = shipped_file(name)
        assert read_onnx(path)[1].record == record
    assert record_entries(NetworkRecord()) == {}, "files of older versions keep their bytes"


@pytest.mark.parametrize("bad", [{"margin_px": "-9"}, {"margin_px": "ab"}, {"protocol": "other"}])
def test_a_damaged_record_is_refused(tmp_path: Path, bad: dict[str, str]) -> None:
    path = shipped_file("face")
    model = onnx.load(path)
    onnx.helper.set_model_props(model, {f"glsim.{name}": text for name, text in bad.items()})
    damaged = tmp_path / "damaged.onnx"
    onnx.save(model, damaged)
    with pytest.raises(DenoiserError, match=r"damaged\.onnx: is damaged"):
        load_onnx(damaged)
