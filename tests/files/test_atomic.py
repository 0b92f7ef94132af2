"""Test that files appear whole, that temporary ones are nobody else's, and that none stay."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from glsim.errors import DatasetError
from glsim.files import atomic
from glsim.files.atomic import AtomicFile, temporary_folder, write_atomic
from tests.support.power_cuts import PowerCuts

KILLED = """
import os, signal, sys
from pathlib import Path
from glsim.files.atomic import AtomicFile
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
    os.utime(left, (0, time.time() - 60))
    atomic._remove_stale.cache_clear()  # as in a new process
    write_atomic(b"whole", target)
    assert names(tmp_path) == ["report.html"]


def test_a_temporary_file_in_use_is_not_removed(tmp_path: Path) -> None:
    with AtomicFile(tmp_path / "a") as file:
        (left,) = tmp_path.iterdir()
        os.utime(left, (0, 0))
        atomic._remove_stale.cache_clear()
        write_atomic(b"b", tmp_path / "b")
        file.write(b"a")
    assert names(tmp_path) == ["a", "b"]


KILLED_IN_FOLDER = """
import os, signal, sys
from pathlib import Path
from glsim.files.atomic import temporary_folder
with temporary_folder(Path(sys.argv[1]) if sys.argv[1:] else None) as folder:
    (folder / "sub").mkdir()
    (folder / "sub" / "half").write_bytes(b"half")
    print(folder, flush=True)
    if sys.stdin.readline() != "end\\n":
        os.kill(os.getpid(), signal.SIGKILL)
"""


def in_temporary_folder(temporary: Path, *arguments: Path) -> tuple[subprocess.Popen[str], Path]:
    """Start a process that works in a temporary folder until it is told what to do."""
    environment = {"PYTHONPATH": str(Path(__file__).parents[2]), "TMPDIR": str(temporary)}
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED_IN_FOLDER, *map(str, arguments)],
        env=os.environ | environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


@pytest.mark.parametrize("inside", [True, False])
def test_the_temporary_folder_of_a_killed_process_goes_at_the_next_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: bool
) -> None:
    system = tmp_path / "system"
    system.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(system))
    place = tmp_path if inside else system
    process, left = in_temporary_folder(system, *([tmp_path] if inside else []))
    assert left.parent == place
    assert left.stat().st_mode & 0o777 == 0o700
    os.utime(left, (0, 0))
    atomic._remove_stale.cache_clear()  # as in a new process
    with temporary_folder(tmp_path if inside else None):
        assert (left / "sub" / "half").read_bytes() == b"half", "its process lives"
    process.communicate("die\n", timeout=20)
    os.utime(left, (0, 0))
    atomic._remove_stale.cache_clear()
    with temporary_folder(tmp_path if inside else None) as folder:
        assert not left.exists()
        assert folder.exists()
    assert not [name for name in names(place) if name.startswith(".glsim-")]


def test_the_temporary_folder_of_a_process_that_ends_is_gone(tmp_path: Path) -> None:
    process, folder = in_temporary_folder(tmp_path)
    process.communicate("end\n", timeout=20)
    assert process.returncode == 0
    assert not folder.exists()


def test_temporary_folders_of_other_users_and_new_ones_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("new", "old", "others"):
        (tmp_path / f".glsim-{name}.tmp").mkdir()
    (tmp_path / "precious").mkdir()
    (tmp_path / ".glsim-link.tmp").symlink_to(tmp_path / "precious")
    for name in ("old", "others", "link"):
        os.utime(tmp_path / f".glsim-{name}.tmp", (0, 0), follow_symlinks=False)
    other = (tmp_path / ".glsim-others.tmp").stat().st_ino
    look = os.fstat

    def foreign(descriptor: int) -> object:
        status = look(descriptor)
        if status.st_ino != other:
            return status
        return os.stat_result((*status[:4], os.geteuid() + 1, *status[5:]))

    monkeypatch.setattr(os, "fstat", foreign)
    atomic._remove_stale.cache_clear()
    write_atomic(b"whole", tmp_path / "a")
    left = {".glsim-link.tmp", ".glsim-new.tmp", ".glsim-others.tmp", "a", "precious"}
    assert set(names(tmp_path)) == left


def test_a_temporary_folder_that_cannot_be_made_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    match = r"^cannot write .*: No such file or dir"
    with pytest.raises(DatasetError, match=match), temporary_folder():
        pass


def test_a_planted_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "victim").write_bytes(b"keep")
    (tmp_path / "temporary").symlink_to(tmp_path / "victim")
    with pytest.raises(DatasetError, match="File exists"):
        write_atomic(b"new", tmp_path / "a", temporary=tmp_path / "temporary")
    assert (tmp_path / "victim").read_bytes() == b"keep"


def test_names_of_temporary_files_cannot_be_guessed(tmp_path: Path) -> None:
    seen = set()
    for _ in range(3):
        with AtomicFile(tmp_path / "a"):
            seen.add(next(p.name for p in tmp_path.iterdir() if p.suffix == ".tmp"))
    assert len(seen) == 3
    assert not any(str(os.getpid()) in name for name in seen)


def test_a_long_name_is_written_and_a_longer_one_is_one_line(tmp_path: Path) -> None:
    write_atomic(b"a", tmp_path / ("n" * 255))
    with pytest.raises(DatasetError, match="File name too long: choose a shorter name"):
        write_atomic(b"a", tmp_path / ("n" * 256))
    assert names(tmp_path) == ["n" * 255]


def test_a_device_is_written_and_not_replaced(tmp_path: Path) -> None:
    """As root, a rename would replace /dev/null of the whole system."""
    write_atomic(b"gone", Path("/dev/null"))
    assert Path("/dev/null").is_char_device()
    with pytest.raises(DatasetError, match="cannot write /dev/full: No space left on device"):
        write_atomic(b"x" * 10, Path("/dev/full"))
    assert Path("/dev/full").is_char_device()


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(DatasetError, match="Is a directory"):
        write_atomic(b"x", tmp_path / "a")
    assert names(tmp_path) == ["a"]


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
    monkeypatch.setattr(atomic, "_MAX_JSON_BYTES", 11)
    with pytest.raises(DatasetError, match=r"run\.json: cannot be read: .* MB are more than"):
        atomic.read_json(tmp_path / "run.json")
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(DatasetError, match="is a pipe, a socket or a device"):
        atomic.read_json(tmp_path / "pipe.json")


def test_a_planted_pipe_or_link_does_not_hold_a_writer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / ".glsim-0.tmp")
    (tmp_path / "precious").write_text("x")
    (tmp_path / ".glsim-1.tmp").symlink_to(tmp_path / "precious")
    monkeypatch.setattr(atomic, "_STALE_S", -1e9)
    atomic._remove_stale.cache_clear()
    write_atomic(b"whole", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == b"whole"
    assert (tmp_path / "precious").read_text() == "x"
    assert atomic.file_checksum(tmp_path / ".glsim-0.tmp") is None
