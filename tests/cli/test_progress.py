"""Bars and rates: none before an error, and no rate of 0 for what moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.progress import rate_text


@pytest.mark.parametrize(
    ("rate", "text"),
    [(0.28, "0.28/s"), (0.0, "0/s"), (3.14159, "3.1/s"), (9.96, "10/s"), (123.4, "123/s")],
)
def test_slow_rates_are_not_0(rate: float, text: str) -> None:
    assert rate_text(rate) == text


@pytest.mark.parametrize(
    "command",
    [
        ["generate", "-o", "s3://bucket/x", "--subjects", "1"],
        ["generate", "-o", "data", "--source", "folder", "--root", "nothing"],
        ["eval", "nothing", "-d", "median", "-o", "scores"],
        ["import", "biwi", "nothing", "-o", "real"],
    ],
    ids=lambda command: " ".join(command[:4]),
)
def test_an_error_before_the_first_frame_has_no_idle_bar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    command: list[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(command) in (1, 2)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("glsim: error: ")


def test_a_bar_stands_where_frames_are_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = ["--subjects", "1", "--frames-per-subject", "2", "--crop", "32", "--workers", "1"]
    assert main(["generate", "-o", str(tmp_path / "d"), *made]) == 0
    assert "2/2" in capsys.readouterr().err


def test_urls_are_named_as_they_were_given(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "s3://bucket/faces"]) == 2
    assert "glsim: error: s3://bucket/faces: no such file" in capsys.readouterr().err
