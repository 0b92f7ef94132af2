"""Exported networks: ONNX files that OpenCV and onnxruntime run, with the results of PyTorch."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from glsim.cli import main
from glsim.denoise import load
from glsim.denoise.inference import TorchNetwork, load_network
from glsim.denoise.network import NetworkDenoiser
from glsim.denoise.onnx_file import Runtime, load_onnx
from glsim.errors import DenoiserError, TrainError
from glsim.train.models.base import DepthModel, Prediction
from glsim.train.onnx_export import TOLERANCE_MM, export_onnx
from tests.support.networks import frames, write_checkpoint

RUNTIMES: tuple[Runtime, ...] = ("opencv", "onnxruntime")


@pytest.mark.parametrize(
    ("wrapper", "backbone"),
    [
        *(("paper", name) for name in ("dncnn", "unet", "artifact_removal")),
        pytest.param("uncertain", "small_unet", marks=pytest.mark.long),
        pytest.param("masked", "unet-plain", marks=pytest.mark.long),
        pytest.param("masked", "partial_conv", marks=pytest.mark.long),
        pytest.param("masked", "normalized_conv", marks=pytest.mark.long),
        pytest.param("surfaces", "small_unet-silu", marks=pytest.mark.long),
    ],
)
def test_both_runtimes_give_the_results_of_pytorch(
    tmp_path: Path, wrapper: str, backbone: str
) -> None:
    """Sizes other than the exporter's, some of them no multiple of 16."""
    write_checkpoint(tmp_path / "best.pt", wrapper, backbone)
    export_onnx(tmp_path / "best.pt", tmp_path / "net.onnx")
    expected = load_network(tmp_path / "best.pt")
    exported = [load_onnx(tmp_path / "net.onnx", runtime=runtime) for runtime in RUNTIMES]
    for height, width in ((53, 67), (128, 144), (16, 31)):
        frame = frames(1, height, width)[0, 0].numpy()
        depth_mm, validity = expected(frame, frame > 0)
        for denoise in exported:
            exported_mm, exported_validity = denoise(frame, frame > 0)
            assert exported_mm.dtype == np.float32
            assert exported_mm.shape == (height, width)
            np.testing.assert_allclose(exported_mm, depth_mm, atol=TOLERANCE_MM, rtol=0)
            np.testing.assert_array_equal(exported_validity > 0.5, validity > 0.5)
            assert denoise.uncertain == expected.uncertain
            if denoise.uncertain:
                sigma_mm = denoise.with_uncertainty(frame, frame > 0)[2]
                wanted_mm = expected.with_uncertainty(frame, frame > 0)[2]
                np.testing.assert_allclose(sigma_mm, wanted_mm, rtol=1e-3)


def test_the_shipped_network_needs_no_pytorch(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("torch", "onnxruntime", "glsim.denoise.inference"):
        monkeypatch.setitem(sys.modules, package, None)
    frame = frames(1, 64, 80)[0, 0].numpy()
    depth_mm, probability = load("face").denoise_map(frame)
    inner = np.s_[8:-8, 40:-8]
    assert np.std(depth_mm[inner]) < 0.6 * np.std(frame[inner][frame[inner] > 0])
    assert probability[inner].min() > 0.5


@pytest.mark.parametrize(
    ("wrapper", "backbone"),
    [
        ("paper", "dncnn"),
        pytest.param("surfaces", "small_unet", marks=pytest.mark.long),
    ],
)
def test_the_command_writes_a_file_that_denoise_reads(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    wrapper: str,
    backbone: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_checkpoint(Path("best.pt"), wrapper, backbone)
    assert main(["export", "best.pt", "-o", "out/net.onnx"]) == 0
    assert "OpenCV gives PyTorch's depth within" in capsys.readouterr().err.replace("\n", " ")
    frame = frames(1, 40, 50)[0, 0].numpy()
    by_file = load("out/net.onnx:min_probability=0.9").denoise_map(frame)
    by_checkpoint = load("best.pt:min_probability=0.9").denoise_map(frame)
    np.testing.assert_array_equal(by_file.valid, by_checkpoint.valid)
    np.testing.assert_allclose(by_file.depth_mm, by_checkpoint.depth_mm, atol=TOLERANCE_MM)
    assert main(["export", "best.pt", "-o", "net.pt"]) == 2
    assert "must end in .onnx or .safetensors" in capsys.readouterr().err


def test_files_that_are_no_networks_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "net.onnx"
    with pytest.raises(DenoiserError, match="cannot be read"):
        load_onnx(path)
    write_checkpoint(tmp_path / "best.pt", "paper", "dncnn")
    export_onnx(tmp_path / "best.pt", path)
    whole = path.read_bytes()
    for content in (b"", b"no graph", whole[: len(whole) // 2]):
        path.write_bytes(content)
        for runtime in RUNTIMES:
            with pytest.raises(DenoiserError, match=r"net.onnx: (is damaged|has no output)"):
                load_onnx(path, runtime=runtime)
    path.write_bytes(whole.replace(b"depth_mm", b"depth_cm"))
    with pytest.raises(DenoiserError, match=r"has no output .depth_mm. .*glsim export"):
        load_onnx(path)
    monkeypatch.setattr("glsim.denoise.onnx_file._MAX_BYTES", 100)
    with pytest.raises(DenoiserError, match="cannot be read"):
        load_onnx(path)


def test_a_network_that_returns_nan_is_refused() -> None:
    class Damaged(DepthModel):
        def forward(self, noisy_mm: torch.Tensor) -> Prediction:
            return Prediction(noisy_mm * torch.nan)

    frame = frames(1)[0, 0].numpy()
    with pytest.raises(DenoiserError, match="weights are damaged"):
        NetworkDenoiser(TorchNetwork(Damaged()), "damaged.pt", False)(frame, frame > 0)


def test_an_architecture_that_opencv_cannot_run_is_refused(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "best.pt", "paper", "restormer")
    with pytest.raises(TrainError, match="OpenCV cannot run this architecture"):
        export_onnx(tmp_path / "best.pt", tmp_path / "net.onnx")
    assert not (tmp_path / "net.onnx").exists()


def test_a_file_that_differs_from_pytorch_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_checkpoint(tmp_path / "best.pt", "paper", "dncnn")
    monkeypatch.setattr("glsim.train.onnx_export.TOLERANCE_MM", -1.0)
    with pytest.raises(TrainError, match="not written"):
        export_onnx(tmp_path / "best.pt", tmp_path / "net.onnx")
    assert not (tmp_path / "net.onnx").exists()
