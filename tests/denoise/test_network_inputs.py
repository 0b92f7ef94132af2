"""Networks that see infrared and neighbours: the same in PyTorch and both ONNX runtimes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glsim
from glsim.cli import main
from glsim.denoise import load
from glsim.denoise.inputs import NetworkInputs
from glsim.denoise.loading import shipped_file
from glsim.denoise.onnx_file import Runtime, load_onnx
from glsim.denoise.onnx_inputs import read_inputs
from glsim.errors import DenoiserError
from glsim.files.png import encode_png, read_depth_png
from glsim.train.onnx_export import TOLERANCE_MM, export_onnx
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.networks import INPUTS, frames, write_checkpoint

RUNTIMES: tuple[Runtime, ...] = ("opencv", "onnxruntime")


@pytest.fixture(scope="module", params=[name for name in INPUTS if name != "frame"])
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("net") / request.param
    folder.mkdir()
    export_onnx(write_checkpoint(folder / "best.pt", inputs=request.param), folder / "net.onnx")
    return folder


def sequence(height: int = 53, width: int = 67) -> tuple[NDArray[Any], NDArray[Any]]:
    """Four frames of a surface with a step and holes, and its infrared."""
    stack = frames(4, height, width)[:, 0].numpy()
    return stack, np.where(stack[1] > 0, 2e9 / np.maximum(stack[1], 1) ** 2, 0).astype(np.float32)


@pytest.mark.long
@pytest.mark.parametrize("runtime", RUNTIMES)
def test_both_runtimes_give_the_results_of_pytorch(network: Path, runtime: Runtime) -> None:
    assert read_inputs((network / "net.onnx").read_bytes()) == NetworkInputs(**INPUTS[network.name])
    by_torch = load(str(network / "best.pt"))
    exported: Any = load_onnx(network / "net.onnx", runtime=runtime)
    for size in ((53, 67), (128, 144)):
        stack, infrared = sequence(*size)
        expected, sigma_mm = by_torch.with_sigma(stack, 1, infrared)
        arguments = (stack, stack > 0, 1) if by_torch.temporal else (stack[1], stack[1] > 0)
        depth_mm, validity, found_sigma_mm = exported.with_uncertainty(*arguments, infrared)
        np.testing.assert_allclose(depth_mm, expected.depth_mm, atol=TOLERANCE_MM, rtol=0)
        np.testing.assert_array_equal(validity > 0.5, expected.valid > 0.5)
        np.testing.assert_allclose(found_sigma_mm, sigma_mm, rtol=1e-3)


@pytest.mark.long
def test_every_input_has_an_effect_and_may_be_missing(network: Path) -> None:
    method = load(str(network / "net.onnx"))
    inputs = NetworkInputs(**INPUTS[network.name])
    assert (method.before, method.after, method.infrared) == (*inputs[1:], inputs.infrared)
    stack, infrared = sequence()
    whole = method(stack, 1, infrared).depth_mm
    without_light = method(stack, 1).depth_mm
    assert np.array_equal(whole, without_light) == (not inputs.infrared)
    alone = method(stack[1:2], 0, infrared).depth_mm
    assert np.array_equal(whole, alone) == (not inputs.temporal)
    with_gap = method(np.stack([0 * stack[0], stack[1], 0 * stack[2]]), 1, infrared).depth_mm
    np.testing.assert_array_equal(with_gap, alone)  # a frame without depth is as none


def test_infrared_of_another_size_is_refused(tmp_path: Path) -> None:
    denoise = glsim.load_denoiser(str(write_checkpoint(tmp_path / "best.pt", inputs="infrared")))
    stack, infrared = sequence()
    assert denoise(stack[1], infrared=infrared).depth_mm.shape == stack[1].shape
    with pytest.raises(glsim.GlsimError, match="infrared of shape"):
        denoise(stack[1], infrared=infrared[1:])
    with pytest.raises(DenoiserError, match="infrared of shape"):
        denoise.method(stack, 1, infrared[1:])


def test_a_stream_gives_a_network_its_earlier_frames(tmp_path: Path) -> None:
    denoise = glsim.load_denoiser(
        str(write_checkpoint(tmp_path / "best.pt", inputs="video")), composite="hard"
    )
    stack, _ = sequence()
    stream = denoise.stream()
    pushed = [stream.push(frame).depth_mm for frame in stack]
    whole = denoise.finished(denoise.method(stack, 3), stack[3]).depth_mm
    np.testing.assert_array_equal(pushed[3], whole)
    assert not np.array_equal(pushed[3], denoise(stack[3]).depth_mm)


def test_an_option_limits_the_earlier_frames(tmp_path: Path) -> None:
    path = write_checkpoint(tmp_path / "best.pt", inputs="video")
    limited, whole = load(f"{path}:before=1"), load(str(path))
    assert (limited.before, whole.before) == (1, 4)
    stack, _ = sequence()
    np.testing.assert_array_equal(limited(stack[2:], 1).depth_mm, whole(stack[2:], 1).depth_mm)


def test_bytes_that_are_no_network_have_no_inputs() -> None:
    with shipped_file("face") as path:
        whole = path.read_bytes()
    for data in (
        b"",
        b"no graph",
        whole[: len(whole) // 2],
        whole.replace(b"noisy_mm", b"noisy_cm"),
    ):
        with pytest.raises(ValueError, match=r"is damaged|is cut short|its inputs are"):
            read_inputs(data)


def test_the_command_finds_infrared_and_earlier_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_checkpoint(Path("all.pt"), inputs="all")
    stack, infrared = sequence()
    Path("maps").mkdir()
    Path("light").mkdir()
    for number, frame in enumerate(stack):
        Path(f"maps/f{number}_noisy.png").write_bytes(encode_png(frame.astype(np.uint16)))
        Path(f"maps/f{number}_infrared.png").write_bytes(encode_png(infrared.astype(np.uint16)))
        Path(f"light/f{number}_noisy.png").write_bytes(encode_png(infrared.astype(np.uint16)))
    assert main(["denoise", "maps", "-o", "beside", "-d", "all.pt"]) == 0
    assert main(["denoise", "maps", "-o", "given", "-d", "all.pt", "--infrared", "light"]) == 0
    method = load("all.pt")
    whole = np.round(stack).astype(np.uint16)
    beside, given = (
        read_depth_png(Path(folder) / "f1_noisy.png") for folder in ("beside", "given")
    )
    np.testing.assert_array_equal(beside, given)
    denoised = method(np.floor(stack), 1, np.floor(infrared)).depth_mm
    kept = beside > 0
    assert kept.mean() > 0.5
    assert np.abs(beside[kept].astype(float) - denoised[kept]).max() <= 0.51
    assert whole.shape == stack.shape
    Path("maps/f2_infrared.png").unlink()
    capsys.readouterr()
    assert main(["denoise", "maps", "-o", "no", "-d", "all.pt"]) == 2
    assert "has no infrared image" in capsys.readouterr().err.replace("\n", " ")
    assert main(["denoise", "maps", "-o", "no", "-d", "median", "--infrared", "light"]) == 2
    assert "median does not use infrared" in capsys.readouterr().err.replace("\n", " ")


def test_eval_gives_networks_their_infrared_and_neighbours(tmp_path: Path) -> None:
    make(tmp_path / "data", make_settings(layers=("clean", "noisy", "infrared")), make_tasks(4, 5))
    spec = f"net@{write_checkpoint(tmp_path / 'all.pt', inputs='all')}"
    from glsim.dataset import open_dataset
    from glsim.eval.scoring.blocks import FrameBlock, ScoringJob

    job = ScoringJob(tmp_path / "data", "test", (spec,))
    (result,) = job.run(iter([FrameBlock(0, 0, 5)]))
    assert not result.bad
    found = [row["both_rmse_mm"] for row in result.rows if row["method"] == "net [hard]"]
    pairs = open_dataset(tmp_path / "data").split("test")
    stack = np.stack([pair.noisy_mm for pair in pairs])
    method = load(spec)
    for number, rmse_mm in enumerate(found):
        first = max(0, number - 2)
        part = stack[first : number + 2]
        denoised = method(part, number - first, pairs[number].infrared)
        hard = np.where(denoised.valid > 0.5, denoised.depth_mm, 0)
        both = (hard > 0) & (pairs[number].clean_mm > 0)
        wanted = np.sqrt(np.mean((hard - pairs[number].clean_mm)[both].astype(float) ** 2))
        assert rmse_mm == pytest.approx(wanted, rel=1e-4)


def test_a_network_that_is_not_shipped_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glsim.denoise.loading._SHIPPED_PACKAGE", "no_such_package")
    for name in ("face", "face-video"):
        with pytest.raises(DenoiserError, match=f"has no {name}.onnx"):
            load(name)
