"""New files of a folder are reported when they are complete, in order of their names, once."""

from __future__ import annotations

import io
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from glsim.errors import DatasetError
from glsim.files import arrivals
from glsim.files.arrivals import FolderArrivals, natural_order
from glsim.files.atomic import write_atomic
from glsim.files.png import encode_png

PNG = encode_png(np.full((8, 9), 900, np.uint16))


def watcher(folder: Path) -> FolderArrivals:
    return FolderArrivals(folder, lambda name: not name.endswith(("_clean.png", ".txt")))


def names(found: FolderArrivals) -> list[str]:
    """All files that can be given out now."""
    listed = []
    while (arrival := found.look()) is not None:
        assert arrival.complete
        listed.append(arrival.path.name)
    return listed


def test_numbers_in_names_count_by_value() -> None:
    given = ["frame_10.png", "frame_9.png", "a.png", "frame_9b.png", "frame_010.png"]
    assert sorted(given, key=natural_order) == [
        "a.png", "frame_9.png", "frame_9b.png", "frame_10.png", "frame_010.png",
    ]  # fmt: skip


def test_files_are_given_once_in_the_order_of_their_names(tmp_path: Path) -> None:
    found = watcher(tmp_path)
    assert found.look() is None
    for name in ("10.png", "9.png", "9_clean.png", ".8.png", "x.txt"):
        (tmp_path / name).write_bytes(PNG)
    (tmp_path / "folder.png").mkdir()
    assert names(found) == ["9.png", "10.png"]
    assert found.look() is None
    write_atomic(PNG, tmp_path / "11.png")
    assert names(found) == ["11.png"]


def test_a_file_that_is_being_written_holds_up_those_after_it(tmp_path: Path) -> None:
    found = watcher(tmp_path)
    with (tmp_path / "1.png").open("wb") as half:
        for end in range(0, len(PNG), 7):
            half.write(PNG[end : end + 7])
            half.flush()
            (tmp_path / "2.png").write_bytes(PNG)
            if end + 7 < len(PNG):
                assert found.look() is None
    assert names(found) == ["1.png", "2.png"]


def test_a_file_that_stops_growing_is_given_up_and_taken_when_it_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = watcher(tmp_path)
    (tmp_path / "1.png").write_bytes(PNG[:-20])
    (tmp_path / "2.png").write_bytes(PNG)
    assert found.look() is None
    monkeypatch.setattr(arrivals, "STALLED_S", -1.0)
    given_up = found.look()
    assert given_up is not None
    assert (given_up.path.name, given_up.complete) == ("1.png", False)
    assert names(found) == ["2.png"]
    assert found.look() is None, "it is not given up again and again"
    (tmp_path / "1.png").write_bytes(PNG)
    assert names(found) == ["1.png"]


def test_a_replaced_file_appears_again_and_a_touched_one_does_not(tmp_path: Path) -> None:
    found = watcher(tmp_path)
    file = tmp_path / "latest.png"
    file.write_bytes(PNG)
    assert names(found) == ["latest.png"]
    os.utime(file)
    assert found.look() is None
    write_atomic(PNG, file)
    assert names(found) == ["latest.png"]
    file.unlink()
    assert found.look() is None


def test_times_are_those_of_appearance(tmp_path: Path) -> None:
    (tmp_path / "0.png").write_bytes(PNG)
    found = watcher(tmp_path)
    first = found.look()
    assert first is not None
    assert first.appeared_s is None
    before_s = time.monotonic()
    other = tmp_path / "old.tmp"
    other.write_bytes(PNG)
    os.utime(other, (1.0, 1.0))  # a copy that keeps an old time
    other.replace(tmp_path / "1.png")
    second = found.look()
    assert second is not None
    assert second.appeared_s is not None
    # A file system's clock ticks every few milliseconds.
    assert before_s - 0.05 <= second.appeared_s <= time.monotonic()


def test_a_folder_that_goes_away_is_an_error(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    found = watcher(folder)
    assert found.look() is None
    folder.rmdir()
    with pytest.raises(DatasetError, match="cannot be watched any more"):
        next(iter(found))


def test_an_array_is_taken_when_it_has_the_bytes_of_its_header(tmp_path: Path) -> None:
    found = watcher(tmp_path)
    whole = io.BytesIO()
    np.save(whole, np.full((8, 9), 0.9, np.float32))
    data = whole.getvalue()
    for end in (0, 5, 60, 128, len(data) - 1):
        (tmp_path / "1.npy").write_bytes(data[:end])
        assert found.look() is None
    (tmp_path / "1.npy").write_bytes(data)
    assert names(found) == ["1.npy"]


def test_a_file_without_an_end_is_taken_when_it_has_settled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = watcher(tmp_path)
    file = tmp_path / "1.tif"
    file.write_bytes(b"half")
    os.utime(file, (time.time() + 100, time.time() + 100))  # a file server whose clock is ahead
    assert found.look() is None
    file.write_bytes(b"half and half")
    os.utime(file, (time.time() + 100, time.time() + 100))
    assert found.look() is None, "it has grown"
    monkeypatch.setattr(arrivals, "SETTLED_S", -1.0)
    assert names(found) == ["1.tif"]
    assert found.look() is None
    monkeypatch.setattr(arrivals, "SETTLED_S", 10.0)
    (tmp_path / "2.tif").write_bytes(b"old")
    os.utime(tmp_path / "2.tif", (1.0, 1.0))
    assert names(found) == ["2.tif"], "what was there long ago is not waited for"


class Listener:
    """Takes the arrivals of a folder on a thread of its own."""

    def __init__(self, folder: Path) -> None:
        self.found = watcher(folder)
        self.seen: list[str] = []
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            for arrival in self.found:
                self.seen.append(arrival.path.name)
        except DatasetError as error:
            self.error = error

    def wait_for(self, names: list[str]) -> None:
        end = time.monotonic() + 60
        while self.seen != names and self.error is None and time.monotonic() < end:
            time.sleep(0.005)
        assert self.seen == names


def listings(monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """One entry for each time that a folder is listed."""
    counted: list[None] = []
    plain = FolderArrivals._list

    def counting(self: FolderArrivals) -> None:
        counted.append(None)
        plain(self)

    monkeypatch.setattr(FolderArrivals, "_list", counting)
    return counted


def test_the_system_says_what_is_new_and_the_folder_is_hardly_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To list 10,000 files a hundred times a second took half a core."""
    monkeypatch.setattr(arrivals, "LISTING_SHARE", 1e9)  # never again
    counted = listings(monkeypatch)
    (tmp_path / "0.png").write_bytes(PNG)
    listener = Listener(tmp_path)
    listener.wait_for(["0.png"])
    time.sleep(0.1)  # watchfiles has begun
    expected = ["0.png"]
    for number in range(1, 6):
        write_atomic(PNG, tmp_path / f"{number}.png")
        expected.append(f"{number}.png")
        listener.wait_for(expected)
    with (tmp_path / "6.png").open("wb") as half:
        half.write(PNG[:30])
        half.flush()
        time.sleep(0.1)
        assert listener.seen == expected
        half.write(PNG[30:])
    listener.wait_for([*expected, "6.png"])
    write_atomic(PNG, tmp_path / "6.png")  # replaced
    listener.wait_for([*expected, "6.png", "6.png"])
    assert len(counted) == 1


def test_without_word_of_the_system_the_folder_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As for files that another machine writes into a network folder, or without watches left."""

    def none_left(*_: object, **__: object) -> Iterator[set[tuple[int, str]]]:
        raise OSError("OS file watch limit reached")

    for watch in (none_left, silent):
        monkeypatch.setattr("watchfiles.watch", watch)
        folder = tmp_path / watch.__name__
        folder.mkdir()
        listener = Listener(folder)
        for number in range(1, 4):
            write_atomic(PNG, folder / f"{number}.png")
            listener.wait_for([f"{n}.png" for n in range(1, number + 1)])
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()
        end = time.monotonic() + 60
        while listener.error is None and time.monotonic() < end:
            time.sleep(0.01)
        assert "cannot be watched any more" in str(listener.error)


def silent(*_: object, **__: object) -> Iterator[set[tuple[int, str]]]:
    while True:
        time.sleep(0.01)
        yield set()


def test_a_full_folder_is_listed_for_a_twentieth_of_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])

    class Slow:
        """A folder that takes 0.3 s to list."""

        def __enter__(self) -> list[object]:
            clock[0] += 0.3
            return []

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr("os.scandir", lambda folder: Slow())
    monkeypatch.setattr("watchfiles.watch", lambda *_, **__: iter([set()] * 3000))
    counted = listings(monkeypatch)

    def tick(self: FolderArrivals, names: object) -> None:
        clock[0] += 0.01

    monkeypatch.setattr(FolderArrivals, "_note", tick)
    assert list(watcher(tmp_path)) == []
    assert clock[0] > 130
    assert len(counted) == pytest.approx((clock[0] - 100) / 6.3, abs=1.1)
