"""Python stages are code: a line names it when it runs, and nothing runs without need."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.noise.registry import declared_stage, find_stage, is_code
from glsim.sensors.sensor import load_sensor, sensor_code
from glsim.settings.schema import load_settings

CODE = """
from pathlib import Path
Path(__file__).with_name("it_ran").touch()
from glsim import array_stage

@array_stage(lambda p: 2, by_mm=("float", 10, 0, 50, "mm", "how far"))
def farther(view, layers, p):
    "Moves all depth."
    return {"depth": layers["depth"] + p["by_mm"] / 1000}

def plain(view, layers, p):
    return {}

LIMIT = 5
@array_stage(by_mm=("float", LIMIT, 0, 50, "mm", "how far"))
def computed(view, layers, p):
    return {}
"""
SENSOR = """
title = "mine"
[rig]
width = 64
height = 64
focal_px = [60, 60]
centre_px = [32, 32]
[[stage]]
use = "mine.py:farther"
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(CODE)
    (tmp_path / "mine.toml").write_text(SENSOR)
    return tmp_path


def test_code_is_named_when_it_runs(here: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        load_sensor("mine.toml")
        load_sensor("mine.toml")
    assert (here / "it_ran").exists()
    lines = [line for line in caplog.messages if "runs code of" in line]
    assert len(lines) <= 1  # once a process
    assert not lines or "mine.py" in lines[0]
    caplog.clear()
    (here / "other.py").write_text(CODE)
    find_stage(f"{here / 'other.py'}:farther")
    assert caplog.messages == [
        f"runs code of {here / 'other.py'}: name only files whose author you trust"
    ]


def test_a_plan_and_a_list_run_no_code(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["generate", "--plan", "--sensor", "mine.toml", "--subjects", "2"]
    assert main([*words, "--frames-per-subject", "2"]) == 0
    assert "nothing was rendered or written" in " ".join(capsys.readouterr().out.split())
    assert main(["stages", "mine.py:farther"]) == 0
    listing = capsys.readouterr().out
    assert "farther: Moves all depth." in listing
    assert "by_mm" in listing
    assert not (here / "it_ran").exists()


def test_what_a_sensor_would_run(here: Path) -> None:
    assert sensor_code(load_settings(overrides={"sensor": "mine.toml"})) == ["mine.py:farther"]
    assert sensor_code(load_settings()) == []
    assert is_code("package.module:stage")
    assert not is_code("axial")
    assert not is_code("a:b.glsl")


def test_a_declaration_is_read_from_the_text(here: Path) -> None:
    spec = declared_stage(here / "mine.py", "farther")
    run = find_stage("mine.py:farther", here)
    assert spec.parameters.keys() == run.parameters.keys()
    assert spec.parameters["by_mm"].default == run.parameters["by_mm"].default == 10
    assert spec.title == run.title
    (here / "broken.py").write_text("def")
    os.mkfifo(here / "pipe.py")
    for use, problem in (
        ("mine.py:plain", "is not a stage"),
        ("mine.py:none", "has no function 'none'"),
        ("mine.py:computed", "'by_mm' is not written out"),
        ("broken.py:x", "is no Python file"),
        ("pipe.py:x", "is a pipe"),
        ("none.py:x", "No such file"),
    ):
        file, _, name = use.partition(":")
        with pytest.raises(ConfigError, match=problem):
            declared_stage(here / file, name)
