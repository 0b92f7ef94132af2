"""Listing of folders of any size: visible names in natural order; loops of links end.

Files with other suffixes are skipped without a call to the disk: a million files take a second.
More than MOST_FILES of the wanted files are refused as soon as they are counted.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator
from pathlib import Path

from glsim.core.errors import ConfigError

log = logging.getLogger(__name__)

#: Largest number of files in one listing: two hours of frames at 30 Hz are 216,000.
MOST_FILES = 250_000
#: Largest number of sub-folders: real sets have hundreds, a link to the root of a disk millions.
_MOST_FOLDERS = 20_000
#: Number of files from which on a line says that sorting takes time: 50 us each, measured.
_MANY = 40_000
_DIGITS = re.compile(r"(\d+)", re.ASCII)


def natural(name: str | Path) -> tuple[list[str | int], str]:
    """Return the sort key for natural order, without regard to case: a2, A10, b."""
    parts = _DIGITS.split(str(name))
    return [int(part) if n % 2 else part.lower() for n, part in enumerate(parts)], str(name)


def entries(folder: Path, ends: tuple[str, ...] = ("",)) -> tuple[list[str], list[str]]:
    """Return the names of the visible files with one of these suffixes, and of the sub-folders.

    Both are in natural order. ``ends`` are suffixes in lower case; names match in any case. Raises
    ConfigError for an unreadable folder, or more than MOST_FILES of these files.
    """
    files: list[str] = []
    folders: list[str] = []
    try:
        with os.scandir(folder) as found:
            for entry in found:
                name = entry.name
                if name.startswith("."):
                    continue
                if entry.is_dir():
                    folders.append(name)
                elif name.lower().endswith(ends):
                    name.encode()  # what is not UTF-8 no manifest or terminal can show
                    files.append(name)
                    check_number(folder, len(files))
    except UnicodeEncodeError as error:
        raise ConfigError(f"{folder}: {error.object!a} is no UTF-8: rename the file") from None
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be listed ({error.strerror or error})") from None
    if len(files) > _MANY:
        log.warning("%s: sorts %d files, which takes some seconds", folder, len(files))
    return sorted(files, key=natural), sorted(folders, key=natural)


def check_number(folder: Path, count: int) -> None:
    """Raise ConfigError if a folder has more than MOST_FILES files."""
    if count > MOST_FILES:
        raise ConfigError(
            f"{folder}: holds more than {MOST_FILES} files to read: give a part of them"
        )


def files_below(
    folder: Path, ends: tuple[str, ...], seen: set[str] | None = None
) -> Iterator[Path]:
    """Yield the files of a folder and its sub-folders, as ``entries`` lists them.

    ``seen`` holds the real paths of folders to skip; visited folders are added to it. Raises
    ConfigError like ``entries``, and for more than _MOST_FOLDERS folders.
    """
    seen = set() if seen is None else seen
    if (real := os.path.realpath(folder)) in seen:
        return
    if len(seen) > _MOST_FOLDERS:
        raise ConfigError(
            f"{folder}: one of more than {_MOST_FOLDERS} folders: does a link lead out of "
            "the set? Remove it, or give a folder with fewer"
        )
    seen.add(real)
    files, folders = entries(folder, ends)
    yield from (folder / name for name in files)
    for name in folders:
        yield from files_below(folder / name, ends, seen)
