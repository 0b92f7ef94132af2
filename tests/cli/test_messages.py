"""Messages name paths as they are, whatever characters a path has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.files.png import encode_png


@pytest.mark.parametrize("name", ["a[/b]c", "exp[v2]", ":smile:", "[red]x"])
def test_paths_are_no_markup(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``-o 'a[/b]c'`` raised MarkupError after all the work; ``exp[v2]`` was printed as ``exp``."""
    monkeypatch.chdir(tmp_path)
    depth = np.full((16, 16), 900, np.uint16)
    (tmp_path / "map.png").write_bytes(encode_png(depth))
    target = tmp_path / name / "map.png"
    assert main(["denoise", "map.png", "-o", f"{name}/map.png", "-d", "median"]) == 0
    assert f"{name}/map.png" in capsys.readouterr().err
    assert target.is_file()
    (tmp_path / name / "bad.png").write_bytes(b"x")
    assert main(["denoise", name, "-o", f"out{name}", "-d", "median"]) == 1
    assert f"skipped {name}/bad.png" in capsys.readouterr().err


def test_no_console_reads_markup() -> None:
    """Every console is made in one place."""
    folder = Path(main.__code__.co_filename).parent
    for file in folder.glob("*.py"):
        if file.name != "common.py":
            assert "Console(" not in file.read_text(encoding="utf-8"), file.name
