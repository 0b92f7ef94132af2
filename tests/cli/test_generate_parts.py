"""``glsim generate``: the plan with its price, and parts on the command line."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.dataset import chunks, verify
from tests.support.dataset_fakes import contents

FEW = ["--subjects", "3", "--frames-per-subject", "4", "--sensor", "ideal", "--crop", "32", "-q"]


@pytest.fixture(autouse=True)
def quiet_again() -> None:
    """-v of one test must not stay for the next one."""
    logging.getLogger().handlers.clear()


def test_a_large_plan_is_a_summary_with_a_price(capsys: pytest.CaptureFixture[str]) -> None:
    plan = ["generate", "--subjects", "1000", "--frames-per-subject", "3600", "--plan"]
    plan += ["--frames-per-second", "100", "--workers", "10"]
    assert main([*plan, "--price-per-core-hour", "0.5"]) == 0
    text = capsys.readouterr().out
    assert "3600000 images" in text
    assert "60 min with 10 worker(s) (size: typical; speed: 100/s of a core as given)" in text
    assert "10 core-hours: 5.00 at 0.5 per core-hour" in text
    assert "p0000" not in text
    assert len(text.splitlines()) < 20


def test_verbose_plans_list_the_people(capsys: pytest.CaptureFixture[str]) -> None:
    plan = ["generate", *FEW[:4], "--plan", "--frames-per-second", "50"]
    assert main([*plan, "--verbose"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    people = [row[2:] for row in rows if row[:2] == ["0", "procedural"] and row[-1] == "images"]
    assert [row[0] for row in people] == ["p0000", "p0001", "p0002"]
    assert {row[1] for row in people} == {"train", "val", "test"}
    assert main([*plan, "--price-per-core-hour", "0"]) == 2
    assert "--price-per-core-hour 0: give a number above 0" in capsys.readouterr().err


def test_parts_and_merge_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 3)
    out = ["generate", "-o", str(tmp_path / "parts"), *FEW, "--workers", "1"]
    assert main([*out, "--merge"]) == 1
    assert "no data set was begun here" in capsys.readouterr().err
    assert main([*out, "--part", "1/2"]) == 0
    assert main([*out, "--merge"]) == 1
    assert "3 of 6 chunks are not made yet, the first is number 0" in capsys.readouterr().err
    monkeypatch.setenv("JOB_COMPLETION_INDEX", "0")
    assert main([*out[:-3], "--workers", "1", "--part", "auto/2"]) == 0
    assert "12 frames (train 4, val 4, test 4)" in capsys.readouterr().err
    assert main([*out, "--merge"]) == 0
    assert verify(tmp_path / "parts", deep=True) == []
    assert main(["generate", "-o", str(tmp_path / "whole"), *FEW, "--workers", "1"]) == 0
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--part", "1/2", "--merge"], "--part and --merge exclude each other: give one of them"),
        (["--part", "7"], "--part 7: give the number of the part and of all, such as 3/16"),
        (["--slurm", "0"], "--slurm 0: give a number of jobs of at least 1"),
    ],
)
def test_wrong_options(
    tmp_path: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", "-o", str(tmp_path / "out"), *FEW, *words]) == 2
    assert message in capsys.readouterr().err
