"""A tree of meshes is walked once, whatever its links are."""

from pathlib import Path

import pytest

from glsim.core.errors import ConfigError
from glsim.core.files import listing
from glsim.core.files.listing import files_below


def test_doubled_links_are_walked_once(tmp_path: Path) -> None:
    """Sixteen folders with two links each to the next would be 65,536 paths."""
    for number in range(17):
        (tmp_path / f"d{number}").mkdir()
    for number in range(16):
        for name in ("a", "b"):
            (tmp_path / f"d{number}" / name).symlink_to(tmp_path / f"d{number + 1}")
    (tmp_path / "d16" / "face.obj").write_text("")
    found = list(files_below(tmp_path / "d0", (".obj",)))
    assert [path.resolve() for path in found] == [tmp_path / "d16" / "face.obj"]


def test_a_link_to_a_disk_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "_MOST_FOLDERS", 50)
    for number in range(60):
        (tmp_path / "disk" / str(number)).mkdir(parents=True)
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "link").symlink_to(tmp_path / "disk")
    with pytest.raises(ConfigError, match="does a link lead out of the set"):
        list(files_below(tmp_path / "set", (".obj",)))


def test_only_what_is_wanted_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "MOST_FILES", 12)
    for number in range(12):
        for name in (f"A{number}.PNG", f"a{number}.txt", f"._a{number}.png", f"b{number}"):
            (tmp_path / name).touch()
    (tmp_path / "b10").unlink()
    (tmp_path / "b10").mkdir()
    files, folders = listing.entries(tmp_path, (".png",))
    assert (files, folders) == ([f"A{number}.PNG" for number in range(12)], ["b10"])
    (tmp_path / "a12.png").touch()
    with pytest.raises(ConfigError, match="holds more than 12 files to read"):
        listing.entries(tmp_path, (".png",))


def test_many_files_are_said_before_they_are_sorted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(listing, "_MANY", 1)
    monkeypatch.setattr(listing, "natural", int)  # sorting fails
    for name in "ab":
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match="invalid literal"):
        listing.entries(tmp_path)
    assert "sorts 2 files" in caplog.text
