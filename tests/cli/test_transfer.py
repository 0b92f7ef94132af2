"""``glsim transfer`` in miniature: from nothing to the tables, and on from where it stopped."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.transfers.steps import Pace, Step
from glsim.sensors.sensor import SENSOR_FOLDER

TINY = """
title = "tiny"
[[sensor]]
name = "led3d"
[[sensor]]
name = "fankhauser"
sensor = "kinect-v2-fankhauser"
tof = true
[[sensor]]
name = "none"
sensor = "no-such-sensor"
optional = true
[[source]]
name = "heads"
kind = "procedural"
[[source]]
name = "ict"
kind = "ict-facekit"
optional = true
[test]
people = 2
tune_people = 1
frames = 1
crop = 64
[train]
steps = 4
people = 2
val_people = 1
frames = 1
crop = 64
recipe = "mask-aware-small"
set = ["training.batch=1", "model.backbone.width=4", "model.backbone.depth=3"]
"""


def study(tmp_path: Path, *more: str, text: str = TINY) -> list[str]:
    (tmp_path / "tiny.toml").write_text(text)
    out = str(tmp_path / "o")
    return ["transfer", "-o", out, "--study", str(tmp_path / "tiny.toml"), "--workers", "1", *more]


def table(out: Path) -> list[dict[str, str]]:
    with (out / "transfer.csv").open() as file:
        return list(csv.DictReader(file))


def test_from_nothing_and_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "o"
    assert main(study(tmp_path, "--leave", "sensor:led3d")) == 0
    said = capsys.readouterr().err
    assert "none is left out: this glsim has no sensor no-such-sensor" in said
    assert "ict is left out: give its folder with --ict-root" in said
    assert "3/5" in said
    rows = table(out)
    assert {row["sensor"] for row in rows} == {"led3d"}
    assert {row["left_out"] for row in rows} == {"sensor led3d"}
    assert [row["scene"] for row in rows] == [""] * 4 + ["alone"] * 4
    for row in rows:
        ratio = float(row["network_mean"]) / float(row["filter_mean"])
        assert float(row["to_filter"]) == pytest.approx(ratio, rel=1e-6)
    text = (out / "transfer.md").read_text()
    assert "`fankhauser_all-faces`: mask-aware DnCNN, 7 layers, 4 steps on sensors " in text
    assert "on sensors fankhauser; faces heads" in text
    assert "about `expected`" in text
    results = json.loads((out / "transfer.json").read_text())
    assert results["cells"][0]["people"] == 2
    assert (out / "transfer.png").read_bytes()[:4] == b"\x89PNG"
    recipe = json.loads((out / "runs" / "fankhauser_all-faces" / "recipe.json").read_text())
    assert recipe["data"]["target"] == "expected"

    # The same command does nothing again; a further sensor adds to what is there.
    run = out / "runs" / "fankhauser_all-faces" / "best.pt"
    before = run.read_bytes(), (out / "transfer.csv").read_bytes()
    assert main(study(tmp_path, "--leave", "sensor:led3d")) == 0
    assert "1/5, 0 s, about 0 s left, was complete: " in capsys.readouterr().err
    assert before == (run.read_bytes(), (out / "transfer.csv").read_bytes())
    assert main(study(tmp_path, "--leave", "all", "--plan")) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum("complete" in line for line in lines) == 5
    assert any("training led3d_all-faces: 4 steps (about" in line for line in lines)


@pytest.mark.long
def test_a_stopped_training_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from glsim.train import loop

    command = study(tmp_path, "--train-on", "fankhauser", "--no-figures", "-q")
    fit, calls = loop.fit, []

    def stopped_after_two(*args, **keywords):  # type: ignore[no-untyped-def]
        def stop() -> bool:
            calls.append(1)
            return len(calls) >= 2

        return fit(*args, **keywords | {"should_stop": stop})

    monkeypatch.setattr(loop, "fit", stopped_after_two)
    assert main(command) == 1
    run = tmp_path / "o" / "runs" / "fankhauser_all-faces" / "run.json"
    assert json.loads(run.read_text())["steps"] == 2
    assert not (tmp_path / "o" / "transfer.md").exists()
    monkeypatch.setattr(loop, "fit", fit)
    assert main(command) == 0
    assert json.loads(run.read_text())["steps"] == 4
    assert {row["sensor"] for row in table(tmp_path / "o")} == {"led3d"}


@pytest.mark.long
def test_given_networks_and_a_sensor_of_ones_own(tmp_path: Path) -> None:
    """Any denoiser can stand in for a network; the noisy input as one is no better than itself."""
    own = (SENSOR_FOLDER / "led3d.toml").read_text().replace("Mu et al", "Mine, after Mu et al")
    (tmp_path / "mine.toml").write_text(own)
    sensor = ["--sensor", str(tmp_path / "mine.toml"), "--leave", "sensor:mine"]
    command = study(tmp_path, *sensor, "--network", "twin@noisy", "--no-figures", "-q")
    assert main(command) == 0
    rows = table(tmp_path / "o")
    assert {(row["network"], row["sensor"]) for row in rows} == {("twin", "mine")}
    assert {float(row["to_input"]) for row in rows} == {1.0}
    assert all(float(row["to_filter"]) >= 1 for row in rows)
    assert not (tmp_path / "o" / "runs").exists()
    assert not (tmp_path / "o" / "transfer.png").exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--leave", "sensor:led"], "--leave sensor:led: not in this study (did you mean 'led3d'?"),
        (["--leave", "led3d"], "--leave led3d: write sensor:NAME, source:NAME or all"),
        (["--leave", "source:heads"], "--leave source:heads: nothing else is left to train on"),
        (["--train-on", "any"], "--train-on any: not in this study"),
        (["--network", "face", "--steps", "9"], "--network trains nothing"),
        (["--network", "nowhere.pt"], "nowhere.pt: no such file"),
        (["--network", "a@noisy", "--network", "a@median"], "name it another than a"),
        (["--small"], "give --small or --study"),
        (["--composite", "hardest"], "--composite hardest: choose one of"),
        (["--ict-root", "nowhere"], "--ict-root nowhere: no such folder"),
        (["--sensor", "nowhere.toml"], "nowhere.toml: no such file"),
        (["--sensor", "kinect-v2"], "give a sensor file, which ends in .toml"),
    ],
)
def test_wrong_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], words: str
) -> None:
    assert main(study(tmp_path, *more)) in (1, 2)
    assert words in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('title = "tiny"', "", "title"),
        ("frames = 1", "frame = 1", "no such setting 'test.frame'"),
        ('name = "fankhauser"', 'name = "led3d"', "two are called 'led3d'"),
        ('name = "fankhauser"', 'name = "../up"', "sensor.1.name: String should match pattern"),
        ("tof = true", "settings = { pose.distanse_mm = 9 }", "distanse_mm"),
        ("tof = true", "settings = { stage.axial.sigma = 9 }", "sigma"),
        ('sensor = "no-such-sensor"\noptional = true', "", "none: this glsim has no sensor none"),
        ("[train]", "[train]\nseed = 2000", "the same people"),
        ('recipe = "mask-aware-small"', 'recipe = "mask"', "no such recipe 'mask'"),
    ],
)
def test_wrong_studies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    assert old in TINY
    assert main(study(tmp_path, text=TINY.replace(old, new, 1))) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("options", [["--small"], [], ["--small", "--network", "noisy"]])
def test_shipped_studies_can_be_planned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    assert main(["transfer", "-o", str(tmp_path / "o"), "--plan", *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].endswith("in all; nothing was written")
    trainings = [line for line in lines if "training " in line]
    assert bool(trainings) == ("--network" not in options)
    assert len(set(lines)) == len(lines)
    assert not (tmp_path / "o").exists()


def test_an_estimate_follows_the_pace_of_the_run() -> None:
    steps = [Step("train", "t", 100, lambda: False, lambda: 0)]
    pace = Pace(workers=2)
    before = pace.seconds(steps)
    pace.note("train", 10, 5.0)
    assert pace.seconds(steps) == pytest.approx(50.0)
    assert before != pace.seconds(steps)
    pace.note("train", 0, 100.0)  # a finished training that was only looked at
    assert pace.seconds(steps) == pytest.approx(50.0)
    assert pace.seconds([Step("train", "t", 100, lambda: True, lambda: 0)]) == 0
