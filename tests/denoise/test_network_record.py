"""Checkpoint, safetensors and ONNX file of a network hold the same settings of its denoiser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.denoise import checkpoint, load
from glsim.denoise.loading import shipped_file
from glsim.denoise.onnx_file import load_onnx
from glsim.denoise.onnx_inputs import read_record, record_entries
from glsim.denoise.record import NetworkRecord
from glsim.errors import DenoiserError
from glsim.train.models.registry import build_model
from glsim.train.onnx_export import export_onnx

RECORD = NetworkRecord(protocol="paper", keep_clean=False, margin_px=80, unlikely=0.3)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a checkpoint whose settings all differ from the defaults."""
    table = {"kind": "mask_aware", "keep_clean": False, "unlikely": 0.3}
    table |= {"backbone": {"kind": "small_unet", "width": 4, "scales": 5, "growth": 0.0}}
    content: dict[str, Any] = {"recipe": {"model": table}, "model": build_model(table).state_dict()}
    content |= {"progress": {}, "validation": {}, "data": {"protocol": "paper"}}
    path = tmp_path_factory.mktemp("run") / "best.pt"
    checkpoint.save(path, content)
    return path


@pytest.mark.parametrize("suffix", [".pt", ".safetensors", ".onnx"])
def test_every_file_of_a_network_has_its_record(trained: Path, suffix: str) -> None:
    path = trained.with_suffix(suffix)
    if suffix == ".onnx":
        export_onnx(trained, path)
    elif suffix == ".safetensors":
        checkpoint.export_safetensors(trained, path)
    network: Any = load(str(path)).function
    found = (network.protocol, network.keep_clean, network.margin_px, network.unlikely)
    assert found == RECORD
    plane = np.full((1, 64, 64), 800, np.float32)
    for option, kept in (("", False), (":keep_clean=0", False), (":keep_clean=1", True)):
        method = load(f"{path}{option}")
        assert method.function.keep_clean == kept  # type: ignore[attr-defined]
        assert np.array_equal(method(plane, 0).depth_mm, plane[0]) or not kept


@pytest.mark.parametrize(("scales", "margin_px"), [(2, 48), (4, 48), (5, 80), (6, 144)])
def test_a_network_of_more_scales_sees_farther(scales: int, margin_px: int) -> None:
    small = {"kind": "small_unet", "width": 4, "scales": scales}
    wrapped = {"kind": "artifact_removal", "backbone": small}
    for backbone in (small, wrapped):
        assert build_model({"kind": "mask_aware", "backbone": backbone}).margin_px == margin_px


def test_the_shipped_networks_and_files_without_a_record() -> None:
    for name, record in (
        ("face", NetworkRecord()),
        ("face-azure-kinect", NetworkRecord(unlikely=0.3)),
        ("face-stereo", NetworkRecord(keep_clean=False, margin_px=80)),
    ):
        with shipped_file(name) as path:
            assert read_record(path.read_bytes()) == record
    assert record_entries(NetworkRecord()) == b"", "files of older versions keep their bytes"
    assert read_record(record_entries(RECORD)) == RECORD


@pytest.mark.parametrize(
    ("written", "instead"),
    [
        (b"\x0280", b"\x02-9"),
        (b"\x0280", b"\x02ab"),
        (b"\x030.3", b"\x030.5"),
        (b"\x05paper", b"\x05other"),
    ],
)
def test_a_damaged_record_is_refused(tmp_path: Path, written: bytes, instead: bytes) -> None:
    with shipped_file("face") as path:
        data = path.read_bytes()
    entries = record_entries(RECORD)
    assert written in entries
    damaged = tmp_path / "damaged.onnx"
    damaged.write_bytes(data + entries.replace(written, instead))
    with pytest.raises(DenoiserError, match=r"damaged\.onnx: is damaged"):
        load_onnx(damaged)
