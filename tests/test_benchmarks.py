"""Frames are the same in every way of making them, and a difference is found."""

from pathlib import Path

import pytest

from benchmarks import determinism

pytestmark = pytest.mark.long


def test_frames_are_the_same_in_every_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("1 worker", "parts", "repaired", "2 threads", "reversed", "Prescott")
    every = determinism.ways()
    tried = {name: every[name] for name in names}
    assert determinism.compare(["procedural"], tried, tmp_path) == 0
    assert capsys.readouterr().out.count("same 0/") == len(names)


def test_another_scene_is_found(tmp_path: Path) -> None:
    tried = {
        "1 worker": determinism.ways()["1 worker"],
        "other": determinism.Way(["--workers 1 --seed 5"]),
    }
    assert determinism.compare(["procedural"], tried, tmp_path) == 1
