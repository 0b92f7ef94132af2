"""Test that pictures of a data set say only what the data set knows."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim import preview
from glsim.cli import main
from glsim.reason import Reason


@pytest.mark.parametrize("layers", ["clean,noisy", "clean,noisy,reason"])
def test_a_lost_pixel_of_a_set_without_reasons_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, layers: str
) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["generate", "-o", "data", "--subjects", "1", "--frames-per-subject", "2", "-q"]
    command += ["--layers", layers, "--crop", "96", "--workers", "1", "--split", "1,0,0"]
    assert main([*command, "--sensor", "kinect-v1"]) == 0
    written: list[str] = []
    write = preview._write

    def record(picture: preview.Picture, text: str, at: tuple[int, int], size: float) -> None:
        written.append(text)
        write(picture, text, at, size)

    monkeypatch.setattr(preview, "_write", record)
    assert main(["preview", "data", "-o", "seen", "-q"]) == 0
    unknown = "lost, reason unknown: the data set has no layer reason"
    at_random = f"{int(Reason.DROPPED)} dropped: {Reason.DROPPED.help}"
    assert (unknown in written) == ("reason" not in layers)
    assert at_random not in written or "reason" in layers
