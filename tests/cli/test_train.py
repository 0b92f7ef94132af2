"""``glsim train`` as a user meets it: a data set in, a run out, interrupted and resumed."""

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
import torch

from glsim import generate, load_settings
from glsim.cli import main
from glsim.cli.train import _print_result, stopping
from glsim.core.errors import pip_install
from glsim.core.files.png import read_image
from glsim.denoise.inference import load_network
from glsim.networks import checkpoint
from tests.cli.test_cli import fails
from tests.support.imports import loaded_after

TINY = """
extends = "face"
title = "tiny"
[model.backbone]
kind = "dncnn"
depth = 2
width = 4
[training]
batch = 4
max_epochs = 2
max_steps = 1000
validate_every = 1
validate_unit = "epochs"
precision = "32-true"
[schedule]
warmup_steps = 0
[data]
crop = 32
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 frames of 4 people, 8 of one of them held out."""
    folder = tmp_path_factory.mktemp("data") / "d"
    output = {"crop": 32}
    source = {"subjects": 4, "frames_per_subject": 6}
    settings = load_settings(
        overrides={"split": [0.75, 0.25, 0.0], "output": output}, source=source
    )
    generate(settings, folder, workers=1)
    return folder


@pytest.fixture
def here(here: Path) -> Path:
    (here / "tiny.toml").write_text(TINY)
    return here


def test_the_first_lines_come_before_the_first_validation(
    here: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "tiny.toml", "--data", str(data), "-o", "run"]) == 0
    said = capsys.readouterr().err
    assert said.startswith("tiny: trains in run; loading PyTorch and the data\n")
    loss = r"\d+, epoch 0, \d+\.\d min: loss [\d.]+\n"
    steps = rf"step 1/{loss}(step \d+/{loss})*"  # a slow machine says more of them
    order = rf".*batches of 4 in an epoch.*\n{steps}.*first validation.*\n.*validation loss"
    assert re.search(order, said), said


def test_help_needs_no_pytorch() -> None:
    code = 'from glsim.cli import main; main(["train", "--list"]); main(["train", "--help"])'
    assert not loaded_after(code) & {"torch", "lightning_fabric"}


@pytest.mark.parametrize("ours_mm", [26.0, 1.9])
def test_a_ruined_network_is_said(capsys: pytest.CaptureFixture[str], ours_mm: float) -> None:
    best = {"monitor": "loss", "value": 1.0, "step": 3}
    figures = {"interior_rmse_mm": ours_mm, "input_interior_rmse_mm": 2.05}
    report = {"state": "finished", "ended": "steps", "steps": 3, "seconds": 9.0, "best": best}
    _print_result(report | {"validation": figures}, Path("run"))
    worse = "worse inside than its input: 26 against 2.05 mm (last validation)"
    assert (capsys.readouterr().err.splitlines()[1:] == [worse]) is (ours_mm > 2)


def test_train_denoise_and_score(
    data: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "tiny.toml", "--data", str(data)]) == 0
    *lines, end = capsys.readouterr().err.splitlines()
    first, second = (line for line in lines if "validation loss" in line)
    figures = r", \d+\.\d min: validation loss \S+, interior \S+ mm"
    figures += r" \(input \S+\), flips \d+ \(input \d+\), mse \d+ mm2"
    assert re.fullmatch(r"step 4/8, epoch 1" + figures, first)
    assert re.fullmatch(r"step 8/8, epoch 2" + figures, second)
    assert "finished (epochs) after 8 steps" in end
    run = here / "runs" / "tiny"
    report = json.loads((run / "run.json").read_text())
    assert (report["state"], report["epochs"], report["title"]) == ("finished", 2, "tiny")
    assert report["data"]["frames"] == {"train": 18, "val": 6, "test": 0}
    noisy = next((data / "val").rglob("*noisy*.png"))
    best = str(run / "best.pt")
    assert main(["denoise", str(noisy), "-o", "clean.png", "-d", best, "-q"]) == 0
    assert (here / "clean.png").is_file()
    command = ["eval", str(data), "--split", "val", "-d", best, "-o", "scores", "--no-figures"]
    assert main([*command, "--workers", "2", "-q"]) == 0
    assert "best.pt" in (here / "scores" / "table.md").read_text()
    scales = [
        checkpoint.load(run / name)["model"]["sigma_scale"] for name in ("best.pt", "last.pt")
    ]
    assert scales[0] != 1, "calibrated by the frames of the validation"
    assert scales[1] == 1, "which training knows nothing of"
    frame = read_image(noisy).astype(np.float32)
    *_, sigma_mm = load_network(run / "best.pt")(frame[None], frame[None] > 0, 0)
    assert (sigma_mm > 0).all()


def test_data_sets_are_joined(data: Path, here: Path) -> None:
    command = ["train", "tiny.toml", "--data", str(data), "--data", str(data), "-q", "-o", "r"]
    assert main([*command, "--set", "training.max_epochs=1"]) == 0
    report = json.loads((here / "r" / "run.json").read_text())
    assert report["steps"] == 2 * 18 // 4
    assert [part["frames"]["val"] for part in report["data"]["sets"]] == [6, 6]


def test_ctrl_c_is_kept_and_resumed(
    data: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["train", "tiny.toml", "--data", str(data), "--set", "loss.beta_mm=2.0"]
    assert main([*command, "-o", "whole", "-q"]) == 0
    read, count = torch.utils.data.DataLoader.__iter__, iter(range(100))

    def read_and_press(self: torch.utils.data.DataLoader[object]) -> object:
        if next(count) == 1:  # validation comes in between: the second epoch
            os.kill(os.getpid(), signal.SIGINT)
        return read(self)

    with monkeypatch.context() as patch:
        patch.setattr(torch.utils.data.DataLoader, "__iter__", read_and_press)
        assert main([*command, "-o", "parts", "--resume"]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "parts: holds no training to go on with: begins anew" in said
    assert "--data, -o and --resume" in said
    assert json.loads((here / "parts" / "run.json").read_text())["state"] == "interrupted"
    assert "--resume" in fails(capsys, 1, *command, "-o", "parts")
    other = (*command[:4], "-o", "parts", "--resume", "--set", "loss.beta_mm=3.0")
    assert "loss.beta_mm is 2.0, not 3.0" in fails(capsys, 1, *other)
    assert main(["train", *command[2:4], "-o", "parts", "--resume"]) == 0  # the folder's recipe
    assert "parts: goes on with loss.beta_mm=2.0" in capsys.readouterr().err
    whole, parts = (checkpoint.load(here / run / "best.pt")["model"] for run in ("whole", "parts"))
    assert all(torch.equal(weight, parts[name]) for name, weight in whole.items())


def test_a_second_signal_ends_at_once() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with stopping() as stop:
        assert not stop()
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is before


def test_options_go_over_the_recipe(data: Path, here: Path) -> None:
    command = ["train", "tiny.toml", "--data", str(data), "-q", "-o", "r"]
    assert main([*command, "--steps", "3", "--seed", "5", "--set", "training.batch=2"]) == 0
    report = json.loads((here / "r" / "run.json").read_text())
    assert (report["steps"], report["seed"], report["ended"]) == (3, 5, "steps")
    recipe = json.loads((here / "r" / "recipe.json").read_text())
    assert recipe["training"]["batch"] == 2
    assert main([*command, "--steps", "1", "--set", "training.max_epochs=1", "-o", "one"]) == 0


@pytest.mark.long
def test_pairs_rendered_while_training(here: Path) -> None:
    command = ["train", "tiny.toml", "--simulate", "-q", "-o", "r", "--set", "data.epoch_steps=2"]
    command += ["--set", "data.validation_frames=4", "--set", "training.batch=1"]
    command += ["--set", "simulate.source.subjects=60"]
    assert main([*command, "--set", "training.max_epochs=1"]) == 0
    assert main([*command, "--resume", "--set", "training.max_epochs=2"]) == 0
    report = json.loads((here / "r" / "run.json").read_text())
    assert (report["epochs"], report["steps"]) == (2, 4)
    assert report["data"]["sensor"] == "kinect-v2"


def test_without_pytorch_it_says_what_to_install(
    data: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("glsim.core.errors.find_spec", lambda name: None)
    line = fails(capsys, 2, "train", "tiny.toml", "--data", str(data))
    assert pip_install("train") in line
    assert "--index-url https://download.pytorch.org/whl/cpu" in line


@pytest.mark.parametrize(
    ("arguments", "status", "problem"),
    [
        ((), 2, "give a recipe"),
        (("tiny.toml",), 2, "--data DIR or --simulate"),
        (("tiny.toml", "--data", "none", "--simulate"), 2, "one of the two"),
        (("tiny.toml", "--data", "none"), 1, "none"),
        (("fase", "--data", "none"), 2, "did you mean 'face'"),
        (("tiny.toml", "--data", "DATA", "--set", "trainin.batch=3"), 2, "'training'"),
        (("tiny.toml", "--data", "DATA", "--set", "model.backbone.depht=3"), 2, "depth"),
        (("tiny.toml", "--data", "DATA", "--set", "loss.beta=3"), 2, "beta_mm"),
        (("tiny.toml", "--data", "DATA", "--set", "data.crop=64"), 1, "--set output.crop=64"),
        (("tiny.toml", "--data", "DATA", "--set", "training.precision=16-mixed"), 2, "needs a GPU"),
    ],
)
def test_bad_input_is_one_line(
    data: Path, here: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...],
    status: int, problem: str,
) -> None:  # fmt: skip
    if "16-mixed" in " ".join(arguments) and torch.cuda.is_available():
        pytest.skip("there is one")
    given = [str(data) if word == "DATA" else word for word in arguments]
    assert problem in fails(capsys, status, "train", *given)
