"""ONNX files: read by both runtimes, with the inputs and settings that they state, or refused."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import glsim
from glsim.cli import main
from glsim.core.errors import DenoiserError
from glsim.core.files.png import encode_png, read_image
from glsim.data.reader import open_dataset
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.registry import load_denoiser, shipped_file
from glsim.eval.scoring.blocks import FrameBlock, ScoringJob
from glsim.networks.inputs import NetworkInputs
from glsim.networks.onnx_file import Runtime, load_onnx, read_content, read_onnx
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.networks import INPUTS, frames, write_checkpoint

RUNTIMES: tuple[Runtime, ...] = ("opencv", "onnxruntime")


def field(number: int, value: bytes | str | int) -> bytes:
    """Encode a short field of a Protocol Buffers message."""
    if isinstance(value, int):
        return bytes([number << 3, value])
    data = value.encode() if isinstance(value, str) else value
    return bytes([number << 3 | 2, len(data)]) + data


def test_large_frames_are_right_by_several_threads_of_opencv() -> None:
    cv2.setNumThreads(2)
    noise = np.random.default_rng(0).normal(0, 3, (1, 576, 640)).astype(np.float32)
    depth_mm, *_ = load_onnx(shipped_file("face"), runtime="opencv")(1500 + noise, noise < 99, 0)
    assert np.abs(depth_mm - 1500).max() < 2


@pytest.mark.parametrize(
    ("graph", "words"),
    [
        (field(1, field(4, "Loop")), "the operator 'Loop'"),
        (field(1, field(4, "Conv") + field(7, "my.ops")), "the operator 'my.ops Conv'"),
        (field(5, field(13, field(1, "location"))), "keeps weights in another file"),
        (field(1, field(4, "Constant") + field(5, field(5, field(13, b"")))), "in another file"),
        (field(1, field(4, "Relu")), "has the inputs none"),
        (field(11, field(1, "x")), "has the inputs 'x'"),
    ],
)
def test_graphs_that_no_export_wrote(tmp_path: Path, graph: bytes, words: str) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(field(1, 8) + field(7, graph))
    with pytest.raises(DenoiserError, match=rf"net\.onnx: is damaged, or is no .*{words}"):
        load_onnx(path)


@settings(max_examples=25)
@given(cut=st.booleans(), place=st.floats(0, 0.999), bit=st.integers(0, 7))
def test_a_damaged_file_is_refused_in_one_line_or_still_runs(
    tmp_path_factory: pytest.TempPathFactory, cut: bool, place: float, bit: int
) -> None:
    data = bytearray(shipped_file("face").read_bytes())
    at = int(place**4 * len(data))  # most often in the graph, which stands before the weights
    if cut:
        del data[at:]
    else:
        data[at] ^= 1 << bit
    damaged = tmp_path_factory.mktemp("net") / "damaged.onnx"
    damaged.write_bytes(data)
    refused = pytest.raises(DenoiserError, match=r"damaged\.onnx[^\n]*$")
    with refused if cut else suppress(DenoiserError):
        load_onnx(damaged, runtime="onnxruntime")


def test_files_that_are_missing_too_large_or_have_other_outputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "net.onnx"
    with pytest.raises(DenoiserError, match="cannot be read"):
        load_onnx(path)
    shipped = shipped_file("face")
    path.write_bytes(shipped.read_bytes().replace(b"depth_mm", b"depth_cm"))
    with pytest.raises(DenoiserError, match=r"has no output .depth_mm. .*glsim export"):
        load_onnx(path)
    monkeypatch.setattr("glsim.networks.onnx_file._MAX_BYTES", 100)
    with pytest.raises(DenoiserError, match="cannot be read"):
        load_onnx(path)


@pytest.fixture(scope="module", params=INPUTS)
def network(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from glsim.train.onnx_export import export_onnx

    folder: Path = tmp_path_factory.mktemp("net") / request.param
    folder.mkdir()
    export_onnx(write_checkpoint(folder / "best.pt", inputs=request.param), folder / "net.onnx")
    return folder


def sequence(height: int = 53, width: int = 67) -> NDArray[Any]:
    """Four frames of a surface with a step and holes."""
    return frames(4, height, width)[:, 0].numpy()


@pytest.mark.long
def test_both_runtimes_give_the_results_of_pytorch(network: Path) -> None:
    _, content = read_onnx(network / "net.onnx")
    assert content.inputs == NetworkInputs(**INPUTS[network.name])
    by_torch = load_denoiser(str(network / "best.pt"))
    for runtime in RUNTIMES:
        exported = Denoiser("net", load_onnx(network / "net.onnx", runtime=runtime))
        for size in ((53, 67), (128, 144)):
            stack = sequence(*size)
            expected = by_torch.estimate(stack, 1)
            found = exported.estimate(stack, 1)
            np.testing.assert_allclose(found.depth_mm, expected.depth_mm, atol=0.01, rtol=0)
            np.testing.assert_array_equal(found.valid > 0.5, expected.valid > 0.5)
            np.testing.assert_allclose(found.sigma_mm, expected.sigma_mm, rtol=1e-3)


@pytest.mark.long
def test_every_input_has_an_effect_and_may_be_missing(network: Path) -> None:
    denoiser = load_denoiser(str(network / "net.onnx"))
    inputs = NetworkInputs(**INPUTS[network.name])
    assert (denoiser.before, denoiser.after) == inputs
    stack = sequence()
    whole = denoiser.estimate(stack, 1).depth_mm
    alone = denoiser.estimate(stack[1:2], 0).depth_mm
    assert np.array_equal(whole, alone) == (not inputs.temporal)
    gap = np.stack([0 * stack[0], stack[1], 0 * stack[2]])  # a frame without depth is as none
    np.testing.assert_array_equal(denoiser.estimate(gap, 1).depth_mm, alone)


def test_a_stream_gives_a_network_its_earlier_frames(tmp_path: Path) -> None:
    path = write_checkpoint(tmp_path / "best.pt", inputs="video")
    denoise = glsim.load_denoiser(str(path), composite="hard")
    stack = sequence()
    pushed = [denoise.push(frame).depth_mm for frame in stack]
    np.testing.assert_array_equal(pushed[3], denoise.estimate(stack, 3).composite("hard"))
    assert not np.array_equal(pushed[3], denoise(stack[3]).depth_mm)
    limited = load_denoiser(f"{path}:before=1")
    assert (limited.before, denoise.before) == (1, 4)


#: A user's function of infrared and of neighbours in time.
LIT = """
def lit(noisy_mm, valid, now, infrared):
    offset_mm = infrared / 1000 + noisy_mm[max(0, now - 2) : now + 2].mean(axis=0) / 100
    return noisy_mm[now] + offset_mm, valid[now], offset_mm
lit.infrared = lit.uncertain = True
lit.before, lit.after = 2, 1
"""


def test_the_command_finds_infrared_and_earlier_frames(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("mine.py").write_text(LIT)
    stack = sequence()
    infrared = np.where(stack[1] > 0, 2e9 / np.maximum(stack[1], 1) ** 2, 0)
    for folder in ("maps", "light"):
        Path(folder).mkdir()
    for number, frame in enumerate(stack):
        Path(f"maps/f{number}_noisy.png").write_bytes(encode_png(frame.astype(np.uint16)))
        for name in (f"maps/f{number}_infrared.png", f"light/f{number}_noisy.png"):
            Path(name).write_bytes(encode_png(infrared.astype(np.uint16)))
    whole = ["-q", "--out-unit-mm", "1"]
    assert main(["denoise", "maps", "-o", "beside", "-d", "mine.py:lit", *whole]) == 0
    given = ["-o", "given", "--uncertainty", "sigma", "--infrared", "light"]
    assert main(["denoise", "maps", *given, "-d", "mine.py:lit", *whole]) == 0
    beside, there, sigma = (
        read_image(Path(folder) / "f1_noisy.png") for folder in ("beside", "given", "sigma")
    )
    np.testing.assert_array_equal(beside, there)
    found = load_denoiser("mine.py:lit").estimate(np.floor(stack), 1, np.floor(infrared))
    kept = beside > 0
    assert kept.mean() > 0.5
    assert np.abs(beside[kept].astype(float) - found.depth_mm[kept]).max() <= 0.51
    assert np.abs(sigma[kept] - 100 * found.sigma_mm[kept]).max() <= 0.51
    assert not sigma[~kept].any()
    Path("maps/f2_infrared.png").unlink()
    capsys.readouterr()
    assert main(["denoise", "maps", "-o", "no", "-d", "mine.py:lit"]) == 2
    assert "has no infrared image" in capsys.readouterr().err.replace("\n", " ")
    assert main(["denoise", "maps", "-o", "no", "-d", "median", "--infrared", "light"]) == 2
    assert "median does not use infrared" in capsys.readouterr().err.replace("\n", " ")


def test_eval_gives_a_function_its_infrared_and_neighbours(tmp_path: Path) -> None:
    make(tmp_path / "data", make_settings(layers=("clean", "noisy", "infrared")), make_tasks(4, 5))
    (tmp_path / "mine.py").write_text(LIT)
    spec = f"mine@{tmp_path / 'mine.py'}:lit"
    job = ScoringJob(tmp_path / "data", "test", (spec,))
    (result,) = job.run(iter([FrameBlock(0, 0, 5)]))
    assert not result.bad
    found = [row["both_rmse_mm"] for row in result.rows if row["method"] == "mine"]
    pairs = open_dataset(tmp_path / "data").split("test")
    stack = np.stack([pair.noisy_mm for pair in pairs])
    denoiser = load_denoiser(spec)
    for number, rmse_mm in enumerate(found):
        first = max(0, number - 2)
        part = stack[first : number + 2]
        found_mm = denoiser.estimate(part, number - first, pairs[number].infrared).composite("")
        both = (found_mm > 0) & (pairs[number].clean_mm > 0)
        wanted = np.sqrt(np.mean((found_mm - pairs[number].clean_mm)[both].astype(float) ** 2))
        assert rmse_mm == pytest.approx(wanted, rel=1e-4)


def test_every_shipped_network_states_what_it_sees() -> None:
    for name, inputs in (("face", NetworkInputs()), ("face-video", NetworkInputs(before=4))):
        path = shipped_file(name)
        assert read_content(path.read_bytes()).inputs == inputs


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reports differ on each system")
def test_onnxruntime_reports_nothing(tmp_path: Path) -> None:
    """Without the switch it keeps a number of the machine and events to send in the cache."""
    network = "from glsim import load_denoiser; load_denoiser('face')(numpy.ones((64, 64)) * 700)"
    written = {}
    for switch, code in (("0", "import onnxruntime"), ("", f"import numpy; {network}")):
        home = tmp_path / f"home{switch}"
        names = ("CI", "ORT_DISABLE_TELEMETRY", "GITHUB_ACTIONS")
        environment = {k: v for k, v in os.environ.items() if k not in names}
        environment |= {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}
        subprocess.run([sys.executable, "-c", code], env=environment, check=True)
        written[switch] = [f.name for f in home.rglob("*") if f.is_file()]
    if "deviceid" not in written["0"]:
        pytest.skip("this onnxruntime does not report")
    assert written[""] == []
