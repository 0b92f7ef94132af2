"""Listing of file trees: natural order, path-safe names, and no endless loops through links."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from glsim.core.errors import ConfigError
from glsim.faces.meshes.obj import EXTENSIONS

_UNSAFE: Final = re.compile(r"[^A-Za-z0-9_+-]")

#: Folders of one subject; real sets have hundreds, a link to the root of a disk millions.
_MAX_FOLDERS: Final = 20_000

_NUMBER: Final = re.compile(r"(\d+)", re.ASCII)


def check_root(root: Path | str) -> Path:
    """Return the root as a Path. Raises ConfigError if it is not a folder."""
    root = Path(root)
    if not root.is_dir():
        problem = "is a file, not a folder" if root.exists() else "there is no such folder"
        raise ConfigError(f"{root}: {problem}; give the folder that contains the meshes")
    return root


def unique_name(name: str, uses: Counter[str]) -> str:
    """Return ``name`` made path-safe, with a suffix "~2", "~3", ... if it was used before."""
    safe = _UNSAFE.sub("_", name)
    uses[safe] += 1
    return safe if uses[safe] == 1 else f"{safe}~{uses[safe]}"


def list_names(folder: Path) -> list[str]:
    """Return the names of a folder's visible entries, in natural order.

    Raises ConfigError if the folder cannot be read.
    """
    try:
        names = [path.name for path in folder.iterdir()]
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be listed ({error.strerror or error})") from None
    return sorted((name for name in names if not name.startswith(".")), key=natural_sort_key)


def find_meshes(folder: Path, seen: set[str]) -> Iterator[Path]:
    """Yield the mesh files of a folder and its sub-folders, visiting each folder once.

    Args:
        seen: real paths of folders that are skipped; those that are visited are added.

    Raises:
        ConfigError: a folder cannot be read, or there are more than _MAX_FOLDERS.
    """
    real = os.path.realpath(folder)
    if real in seen:
        return
    if len(seen) > _MAX_FOLDERS:
        raise ConfigError(
            f"{folder}: one of more than {_MAX_FOLDERS} folders of a subject: does a link lead "
            "out of the face set? Remove it, or give a folder with fewer"
        )
    seen.add(real)
    entries = [folder / name for name in list_names(folder)]
    yield from (path for path in entries if is_mesh(path))
    for path in entries:
        if os.path.isdir(path):  # noqa: PTH112 (False for what this user may not see)
            yield from find_meshes(path, seen)


def is_mesh(path: Path) -> bool:
    """Return whether a path is no folder and has a mesh file's extension."""
    return path.suffix.lower() in EXTENSIONS and not os.path.isdir(path)  # noqa: PTH112


def last_number(stem: str) -> int | None:
    """Return the last run of digits in a name as an integer; None if it has no digits."""
    numbers = _NUMBER.findall(stem)
    return int(numbers[-1]) if numbers else None


def natural_sort_key(name: str) -> tuple[list[tuple[int, int | str]], str]:
    """Return a sort key that compares runs of digits as numbers: "a2" comes before "a10"."""
    parts: list[tuple[int, int | str]] = [
        (0, int(part)) if part.isdigit() else (1, part.lower())
        for part in _NUMBER.split(name)
        if part
    ]
    return parts, name
