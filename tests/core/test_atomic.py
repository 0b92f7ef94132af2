"""Test that files appear whole, that temporary ones are nobody else's, and that none stay."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from glsim.core.errors import DatasetError
from glsim.core.files import atomic
from glsim.core.files.atomic import AtomicFile, temporary_folder, write_atomic
from tests.support.power_cuts import PowerCuts

KILLED = """
import os, signal, sys
from pathlib import Path
from glsim.core.files.atomic import AtomicFile
with AtomicFile(Path(sys.argv[1])) as file:
    file.write(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_killed_writer_leaves_a_temporary_file_that_the_next_one_removes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "report.html"
    root = str(Path(__file__).parents[2])
    subprocess.run(
        [sys.executable, "-c", KILLED, str(target)], env=os.environ | {"PYTHONPATH": root}
    )
    (left,) = tmp_path.iterdir()
    assert left.suffix == ".tmp"
    os.utime(left, (0, 0))
    atomic._remove_stale.cache_clear()  # as in a new process
    write_atomic(b"whole", target)
    assert names(tmp_path) == ["report.html"]


def test_old_temporary_folders_go_and_new_ones_and_links_stay(tmp_path: Path) -> None:
    for name in ("new", "old"):
        (tmp_path / f".glsim-{name}.tmp").mkdir()
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "a").touch()
    (tmp_path / ".glsim-link.tmp").symlink_to(tmp_path / "precious")
    for name in ("old", "link"):
        os.utime(tmp_path / f".glsim-{name}.tmp", (0, 0), follow_symlinks=False)
    atomic._remove_stale.cache_clear()
    with temporary_folder(tmp_path) as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
    assert names(tmp_path) == [".glsim-new.tmp", "precious"]
    assert (tmp_path / "precious" / "a").exists()


def test_a_planted_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "victim").write_bytes(b"keep")
    (tmp_path / "temporary").symlink_to(tmp_path / "victim")
    with pytest.raises(DatasetError, match="File exists"):
        AtomicFile(tmp_path / "a", tmp_path / "temporary")
    assert (tmp_path / "victim").read_bytes() == b"keep"


def test_a_device_is_written_and_not_replaced(tmp_path: Path) -> None:
    """As root, a rename would replace /dev/null of the whole system."""
    write_atomic(b"gone", Path("/dev/null"))
    assert Path("/dev/null").is_char_device()
    with pytest.raises(DatasetError, match="cannot write /dev/full: No space left on device"):
        write_atomic(b"x" * 10, Path("/dev/full"))
    assert Path("/dev/full").is_char_device()


def test_a_file_is_old_or_new_after_a_power_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, kept = tmp_path / "root", tmp_path / "kept"
    kept.mkdir()
    found: list[bytes | None] = []

    def cut(disk: PowerCuts, step: int) -> None:
        for left in (True, False):
            state = tmp_path / f"{step}-{left}"
            disk.write_state(state, names=left)
            file = state / "sub" / "a.json"
            found.append(file.read_bytes() if file.exists() else None)

    root.mkdir()
    disk = PowerCuts(monkeypatch, root, kept, cut)
    write_atomic(b"old", root / "sub" / "a.json")
    first = len(found)
    write_atomic(b"new", root / "sub" / "a.json")
    cut(disk, 1000)
    assert set(found[:first]) == {None, b"old"}
    assert set(found[first:-2]) == {b"old", b"new"}
    assert found[-2:] == [b"new", b"new"], "written files are on the disk"


def test_json_of_a_bounded_size_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.json").write_text('{"steps": 1}')
    assert atomic.read_json(tmp_path / "run.json") == {"steps": 1}
    monkeypatch.setattr(atomic, "MOST_HELD", 11)
    with pytest.raises(DatasetError, match=r"run\.json: cannot be read: .* MB are more than"):
        atomic.read_json(tmp_path / "run.json")
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(DatasetError, match="is a pipe, a socket or a device"):
        atomic.read_json(tmp_path / "pipe.json")
