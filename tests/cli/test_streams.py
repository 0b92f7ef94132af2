"""Closed standard streams, and names that hold a terminal's codes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from glsim.cli.streams import printable


@pytest.mark.parametrize(
    ("arguments", "closed", "status"),
    [("sensors", ">&- 2>&-", 0), ("sensors", ">&- <&-", 0), ("nonsense", "2>&- >&-", 2)],
)
def test_closed_streams_are_no_error(
    tmp_path: Path, arguments: str, closed: str, status: int
) -> None:
    command = f"{sys.executable} -m glsim {arguments} {closed}"
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, check=False)
    assert done.returncode == status
    assert list(tmp_path.iterdir()) == []


def test_a_name_cannot_command_the_terminal() -> None:
    assert printable("a\x1b[2J\rb\u202e é 面\n") == "a\\x1b[2J\\rb\\u202e é 面\n"
