"""Notice images and arrays as they appear in a folder, each once it is complete, in name order.

The system says which names change (watchfiles). What other machines write into a network folder it
does not say, so the folder is also listed again and again, for a twentieth of the time at most:
10,000 files, listed 100 times a second, took half a core, and a new one was noticed after 57 ms.

A PNG file is complete if it ends as PNG files end, a .npy file if it has the bytes that its header
tells of, so that a file that is being written is never read in half, whether its writer renames it
or not. Other files do not tell: they are complete if they have not changed for SETTLED_S.
"""

from __future__ import annotations

import errno
import math
import os
import re
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import watchfiles

from glsim.errors import DatasetError
from glsim.files.npy import map_npy

#: Seconds between two looks at what waits: less than a frame of a camera with 30 Hz.
POLL_S: Final = 0.01
#: Time between two listings of the folder, as a multiple of what one takes. Chosen.
LISTING_SHARE: Final = 20
#: A file that is not complete and has not grown for this long, seconds, is not waited for: chosen;
#: a camera of 30 Hz writes 60 files in that time.
STALLED_S: Final = 2.0
#: A file of a format without an end (TIFF, OpenEXR) that has not changed for this long, seconds, is
#: taken as complete. Chosen: several frames of a camera, and the longest pause of a slow disk.
SETTLED_S: Final = 0.3

#: The last chunk of every PNG file, which holds no data: length, type, CRC32 (W3C, PNG 3rd ed.).
_END: Final = b"\0\0\0\0IEND\xaeB`\x82"


class Arrival(NamedTuple):
    """A new file.

    Attributes:
        appeared_s: when it was completed or renamed, on the clock of time.monotonic; None for a
            file that was there at the first look.
        complete: False for a file that stopped growing too early.
    """

    path: Path
    appeared_s: float | None
    complete: bool


class _Waiting(NamedTuple):
    """The bytes of an incomplete file when it last grew, and the time (time.monotonic)."""

    size: int
    grown_s: float


def natural_order(name: str) -> tuple[tuple[str, int], ...]:
    """Return a key that sorts numbers in names by value: frame_9 before frame_10."""
    parts = re.split(r"(\d+)", name)
    return tuple(
        (text, int(digits or 0))
        for text, digits in zip(parts[::2], [*parts[1::2], ""], strict=True)
    )


class FolderArrivals:
    """The files that appear in a folder, sub-folders left out; a replaced file appears again.

    A file that is not complete holds up those after it, until it stalls.
    """

    def __init__(self, folder: Path, wanted: Callable[[str], bool]) -> None:
        """Watch a folder for wanted names; those with a leading dot are temporary files."""
        self._folder, self._wanted = folder, wanted
        self._known: dict[str, int] = {}  # name -> inode of what was given out
        self._new: dict[str, int] = {}  # name -> inode of what was not given out as it is now
        self._stalled: dict[str, int] = {}  # name -> size of what was given out incomplete
        self._waiting: dict[str, _Waiting] = {}
        self._absent_s: dict[str, float] = {}  # name -> the last look at which it was not there
        self._first: set[str] = set()  # what was there at the first listing
        self._looked_s = time.monotonic()
        self._list_again_s = -math.inf  # before the first listing

    def __iter__(self) -> Iterator[Arrival]:
        """Yield files without end. Raises DatasetError if the folder cannot be read any more."""
        self._list()
        for names in _changes(self._folder):
            if time.monotonic() >= self._list_again_s:
                self._list()
            else:
                self._note(names)
            yield from self._ready()

    def look(self) -> Arrival | None:
        """List the folder, and return the next file if there is one now."""
        self._list()
        return next(self._ready(), None)

    def _ready(self) -> Iterator[Arrival]:
        """Yield the noticed files that are complete or given up, to the first that is neither."""
        for name in sorted(self._new, key=natural_order):
            path = self._folder / name
            try:
                status, complete = path.stat(), self._is_complete(path)
            except OSError:  # removed since, or not ours to read: reading it says why
                if path.exists():
                    yield self._given(Arrival(path, None, False))
                continue
            now_s = time.monotonic()
            if complete:
                # When it was renamed or completed; a clock that is off cannot put this into a time
                # when the file was not there, or into the future.
                age_s = time.time() - status.st_ctime
                appeared_s = min(max(now_s - age_s, self._absent_s[name]), now_s)
                live = name not in self._first
                yield self._given(Arrival(path, appeared_s if live else None, True))
                continue
            waiting = self._waiting.get(name)
            if waiting is None or waiting.size != status.st_size:
                self._waiting[name] = _Waiting(status.st_size, now_s)
            elif now_s - waiting.grown_s > STALLED_S:
                self._stalled[name] = status.st_size
                yield self._given(Arrival(path, None, False))
                continue
            return

    def _list(self) -> None:
        """Notice all files that were not given out as they are now."""
        start_s = time.monotonic()
        try:
            with os.scandir(self._folder) as entries:
                there = {
                    entry.name: entry.inode()
                    for entry in entries
                    if self._may_be(entry.name) and entry.is_file()
                }
        except OSError as error:
            raise DatasetError(
                f"{self._folder}: cannot be watched any more: {error.strerror}"
            ) from None
        self._take(there, gone=self._known.keys() - there.keys())
        if self._list_again_s == -math.inf:
            self._first = set(self._new)
        end_s = time.monotonic()
        self._list_again_s = end_s + max(POLL_S, LISTING_SHARE * (end_s - start_s))

    def _note(self, names: Collection[str]) -> None:
        """Notice what has changed; the rest of the folder is not looked at."""
        there: dict[str, int] = {}
        for name in filter(self._may_be, names):
            path = self._folder / name
            if path.is_file():
                with suppress(OSError):  # removed since
                    there[name] = path.stat().st_ino
        self._take({**self._new, **there}, gone={*names} - there.keys())

    def _take(self, there: dict[str, int], gone: Collection[str]) -> None:
        before_s, self._looked_s = self._looked_s, time.monotonic()
        for name in gone:
            self._known.pop(name, None)
            self._stalled.pop(name, None)
        self._new = {
            name: inode
            for name, inode in there.items()
            if self._known.get(name) != inode or self._has_grown(name)
        }
        for name in self._new:
            self._absent_s.setdefault(name, before_s)

    def _may_be(self, name: str) -> bool:
        return not name.startswith(".") and self._wanted(name)

    def _has_grown(self, name: str) -> bool:
        """Return whether a file that stalled has changed since."""
        if name not in self._stalled:
            return False
        try:
            return (self._folder / name).stat().st_size != self._stalled[name]
        except OSError:
            return False

    def _is_complete(self, path: Path) -> bool:
        """Return whether a file is whole. Raises OSError if it cannot be read."""
        suffix = path.suffix.lower()
        if suffix == ".png":
            return _ends_as_png(path)
        if suffix == ".npy":
            return _has_all_numbers(path)
        status, waiting = path.stat(), self._waiting.get(path.name)
        if time.time() - status.st_mtime > SETTLED_S:
            return True
        # The clock of the file system may be ahead of ours: then its size must stay for so long.
        if waiting is None or waiting.size != status.st_size:
            return False
        return time.monotonic() - waiting.grown_s > SETTLED_S

    def _given(self, arrival: Arrival) -> Arrival:
        name = arrival.path.name
        self._known[name] = self._new.pop(name)
        self._waiting.pop(name, None)
        self._absent_s.pop(name, None)
        if arrival.complete:
            self._stalled.pop(name, None)
        return arrival


def _changes(folder: Path) -> Iterator[set[str]]:
    """Yield names of a folder that have changed, none after POLL_S without one, for ever."""
    wait_ms = round(1000 * POLL_S)
    try:
        for changes in watchfiles.watch(
            folder, watch_filter=None, debounce=wait_ms, step=1, rust_timeout=wait_ms,
            yield_on_timeout=True, recursive=False,
        ):  # fmt: skip
            yield {Path(path).name for _, path in changes}
    except (OSError, RuntimeError):  # the user's watches are used up, or the folder is gone
        while True:
            time.sleep(POLL_S)
            yield set()


def _has_all_numbers(path: Path) -> bool:
    """Return whether a .npy file has the size of its header. Raises OSError: it cannot be read."""
    try:
        map_npy(path)
    except OSError as error:
        if error.errno == errno.EINVAL:  # what is there is no whole file, or none of NumPy
            return False
        raise
    return True


def _ends_as_png(path: Path) -> bool:
    """Return whether a file ends as PNG files do. Raises OSError if it cannot be read."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - len(_END)))
        return file.read(len(_END)) == _END
