"""How the command line ends (signals, a full disk, any error), and the shared options."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.cli.common import options, run_command_line
from glsim.core.files.png import encode_png
from tests.support.imports import ROOT


@pytest.fixture(autouse=True)
def _options_as_before() -> Iterator[None]:
    before = replace(options)
    yield
    vars(options).update(vars(before))


def test_shared_options_hold_for_one_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sensors", "-q"]) == 0
    assert main(["-q", "sensors"]) == 0
    assert options.quiet
    assert main(["stages", "no_such_stage", "--debug"]) == 2
    assert "Traceback" in capsys.readouterr().err
    assert main(["stages", "no_such_stage"]) == 2
    assert not options.quiet
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("press", "name", "text"),
    [
        (signal.SIGTERM, "generate", "terminated: run the same command again to go on"),
        (signal.SIGINT, "train", "interrupted: run it again with --resume to go on"),
        (signal.SIGINT, "adapt", "interrupted: the same command would begin anew"),
    ],
)
def test_signals_are_one_true_line(
    press: signal.Signals, name: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def command(**_: object) -> None:
        os.kill(os.getpid(), press)
        signal.pause()

    ignored = signal.signal(signal.SIGINT, signal.default_int_handler)  # by a shell's "&"
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert run_command_line(command, [name]) == 1
    finally:
        signal.signal(signal.SIGINT, ignored)
    assert capsys.readouterr().err == f"{text}\n"
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (MemoryError(), "out of memory: ask for fewer frames, fewer workers or a smaller crop"),
        (OSError(errno.EIO, os.strerror(errno.EIO), "a.png"), "a.png: Input/output error"),
        (KeyError("a\nb"), "KeyError: 'a\\nb' (a bug; --debug shows where)"),
    ],
)
def test_what_the_system_refuses_is_no_bug(
    error: Exception, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def command(**_: object) -> None:
        raise error

    assert run_command_line(command, []) == 1
    assert capsys.readouterr().err == f"glsim: error: {text}\n"


@pytest.mark.parametrize("command", ["corrupt", "denoise", "render", "inspect"])
@pytest.mark.parametrize(
    ("name", "text"),
    [("n" * 256, "name too long"), ("s3://bucket/faces", "error: s3://bucket/faces")],
)
def test_a_name_of_no_file_is_one_line(
    command: str, name: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "b.png")] if command != "inspect" else []
    assert main([command, name, *out]) in (1, 2)
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line
    assert list(tmp_path.iterdir()) == []


def test_output_to_a_full_device_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "glsim", "stages"],
            cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == "glsim: error: No space left on device\n"


@pytest.mark.parametrize("name", ["a[/b]c", ":smile:"])
def test_paths_are_no_markup(here: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """``-o 'a[/b]c'`` raised MarkupError after all the work."""
    (here / "map.png").write_bytes(encode_png(np.full((16, 16), 900, np.uint16)))
    assert main(["denoise", "map.png", "-o", f"{name}/map.png", "-d", "median"]) == 0
    assert f"{name}/map.png" in capsys.readouterr().err
    assert (here / name / "map.png").is_file()


@pytest.mark.long
def test_an_error_before_the_first_frame_has_no_idle_bar_and_frames_have_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "d"), "--set", "output.crop=32", "--workers", "1"]
    made = ["generate", *out, "--subjects", "1", "--frames-per-subject", "2"]
    assert main([*made, "--source", "folder", "--root", "nothing"]) in (1, 2)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("glsim: error: ")
    assert main(made) == 0
    assert "2/2" in capsys.readouterr().err
