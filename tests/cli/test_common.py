"""Test how the command line ends: signals, a full disk, long names, a deleted folder."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.common import run_command_line

ROOT = Path(__file__).parents[2]
EARLY = """
import sys

class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
from glsim.__main__ import main
sys.exit(main())
"""


def python(code: str, *arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, **options)  # type: ignore[call-overload]


def test_ctrl_c_while_commands_are_imported_is_one_line() -> None:
    done = python(EARLY)
    assert (done.returncode, done.stderr) == (1, "interrupted\n")


def test_sigterm_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def command(**_: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()

    before = signal.getsignal(signal.SIGTERM)
    assert run_command_line(command, []) == 1
    assert capsys.readouterr().err == "terminated: run the same command again to go on\n"
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (MemoryError(), "out of memory: ask for fewer frames, fewer workers or a smaller crop"),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "No space left on device"),
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


NAME = "n" * 256


@pytest.mark.parametrize(
    "words",
    [
        ["denoise", NAME, "-o", "b.png"],
        ["corrupt", NAME, "-o", "b.png"],
        ["render", NAME, "-o", "out"],
        ["preview", NAME],
        ["inspect", NAME],
        ["generate", "-o", NAME, "--subjects", "1"],
        ["generate", "-o", "out", "--config", NAME],
        ["stages", NAME + ".glsl"],
        ["compare", NAME, NAME],
    ],
    ids=lambda words: words[0],
)
def test_a_name_that_is_too_long_is_one_line(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) in (1, 2)
    lines = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert len(lines) == 1
    assert "name too long" in lines[0]
    assert "a bug" not in lines[0]
    assert list(tmp_path.iterdir()) == []


def test_a_deleted_working_folder_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(["stages"]) == 2
    message = "the working folder has been deleted: change to another one"
    assert capsys.readouterr().err == f"glsim: error: {message}\n"
    monkeypatch.chdir(tmp_path)


def test_output_to_a_full_device_is_one_line() -> None:
    code = "import sys; from glsim.__main__ import main; sys.exit(main())"
    with Path("/dev/full").open("w") as full:
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, "-c", code, "stages"],
            env=environment,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr == "glsim: error: No space left on device\n"


def test_more_frames_than_fit_in_memory_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["generate", "-o", "data", "--subjects", "1000000000", "-q"]) == 2
    assert capsys.readouterr().err == (
        "glsim: error: 1000000000 subjects of 30 frames are 30000000000 frames; one data set has "
        "at most 50000000 of 500000 people: make several, with other seeds\n"
    )
