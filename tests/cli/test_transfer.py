"""``glsim transfer`` in miniature: from nothing to the tables, and on from where it stopped."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from glsim.cli import main

TINY = """
title = "tiny"
[[sensor]]
name = "led3d"
[[sensor]]
name = "fankhauser"
sensor = "kinect-v2-fankhauser"
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
recipe = "paper-d7-small"
set = ["training.batch=1", "model.backbone.width=4", "model.backbone.depth=3"]
"""


def study(tmp_path: Path, *more: str, text: str = TINY) -> list[str]:
    (tmp_path / "tiny.toml").write_text(text)
    out = str(tmp_path / "o")
    return ["transfer", "-o", out, "--study", str(tmp_path / "tiny.toml"), "--workers", "1", *more]


def table(out: Path) -> list[dict[str, str]]:
    with (out / "transfer.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.mark.long
def test_a_training_without_a_sensor_stops_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from glsim.train import loop

    command = study(tmp_path, "--leave", "sensor:led3d")
    fit, calls = loop.fit, []

    def stopped_after_two(*args, **keywords):  # type: ignore[no-untyped-def]
        def stop() -> bool:
            calls.append(1)
            return len(calls) >= 2

        return fit(*args, **keywords | {"should_stop": stop})

    monkeypatch.setattr(loop, "fit", stopped_after_two)
    assert main(command) == 1
    run = tmp_path / "o" / "runs" / "without-led3d" / "run.json"
    assert json.loads(run.read_text())["steps"] == 2
    assert not (tmp_path / "o" / "transfer.md").exists()
    said = capsys.readouterr().err
    assert "ict is left out: give its folder with --ict-root" in said
    monkeypatch.setattr(loop, "fit", fit)
    assert main(command) == 0
    assert json.loads(run.read_text())["steps"] == 4
    recipe = json.loads(run.with_name("recipe.json").read_text())
    assert recipe["data"]["target"] == "expected"
    rows = table(tmp_path / "o")
    assert {(row["network"], row["sensor"]) for row in rows} == {("without-led3d", "led3d")}
    for row in rows:
        ratio = float(row["network_mean"]) / float(row["filter_mean"])
        assert float(row["to_filter"]) == pytest.approx(ratio, rel=1e-6)

    # The same command trains nothing again and writes the same results.
    best = run.with_name("best.pt")
    before = best.read_bytes(), (tmp_path / "o" / "transfer.csv").read_bytes()
    capsys.readouterr()
    assert main(command) == 0
    assert "train runs/without-led3d: complete" in capsys.readouterr().err
    assert before == (best.read_bytes(), (tmp_path / "o" / "transfer.csv").read_bytes())


@pytest.mark.long
def test_given_networks_are_scored_in_every_cell(tmp_path: Path) -> None:
    """Any denoiser can stand in for a network; the noisy input as one is no better than itself."""
    assert main(study(tmp_path, "--network", "twin@noisy", "-q")) == 0
    rows = table(tmp_path / "o")
    places = {(row["network"], row["sensor"], row["scene"]) for row in rows}
    assert places == {("twin", "led3d", "alone"), ("twin", "fankhauser", "alone")}
    assert {row["to_input"] for row in rows} <= {"1", "nan"}
    assert not (tmp_path / "o" / "runs").exists()
    # Without a network the filters alone stand in the tables.
    assert main(study(tmp_path, "-q")) == 0
    assert {row["network"] for row in table(tmp_path / "o")} == {""}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--leave", "sensor:led"], "--leave sensor:led: led: not in this study (did you mean"),
        (["--leave", "led3d"], "--leave led3d: write sensor:NAME, source:NAME or all"),
        (["--leave", "source:heads"], "--leave source:heads: nothing else is left to train on"),
        (["--train-on", "any"], "--train-on: any: not in this study"),
        (["--network", "nowhere.pt"], "nowhere.pt: no such file"),
        (["--network", "a@noisy", "--network", "a@median"], "name it another than a"),
        (["--study", "large"], "--study large: no such study"),
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
        ("frames = 1", "frame = 1", "no such setting 'test.frame'"),
        ('name = "fankhauser"', 'name = "led3d"', "two are called 'led3d'"),
        ('name = "fankhauser"', 'name = "../up"', "sensor.1.name: String should match pattern"),
        ('name = "led3d"', 'name = "led3d"\nsettings = { pose.distanse_mm = 9 }', "distanse_mm"),
        ('sensor = "kinect-v2-fankhauser"', "", "fankhauser/heads/alone: no such sensor"),
        ("[train]", "[train]\nseed = 2000", "the same people"),
    ],
)
def test_wrong_studies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    assert old in TINY
    assert main(study(tmp_path, text=TINY.replace(old, new, 1))) == 2
    assert words in capsys.readouterr().err
