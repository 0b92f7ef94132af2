"""A tree of meshes is walked once, whatever its links are."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim.core.errors import ConfigError
from glsim.faces.scans import file_tree
from glsim.faces.scans.file_tree import find_meshes


def test_doubled_links_are_walked_once(tmp_path: Path) -> None:
    """Sixteen folders with two links each to the next would be 65,536 paths."""
    for number in range(17):
        (tmp_path / f"d{number}").mkdir()
    for number in range(16):
        for name in ("a", "b"):
            (tmp_path / f"d{number}" / name).symlink_to(tmp_path / f"d{number + 1}")
    (tmp_path / "d16" / "face.obj").write_text("")
    found = list(find_meshes(tmp_path / "d0", set()))
    assert [path.resolve() for path in found] == [tmp_path / "d16" / "face.obj"]


def test_a_link_to_a_disk_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_tree, "_MAX_FOLDERS", 50)
    for number in range(60):
        (tmp_path / "disk" / str(number)).mkdir(parents=True)
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "link").symlink_to(tmp_path / "disk")
    with pytest.raises(ConfigError, match="does a link lead out of the face set"):
        list(find_meshes(tmp_path / "set", set()))
