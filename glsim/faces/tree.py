"""Listing a tree of files: natural order, path-safe words, no loops of links."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from glsim.errors import ConfigError
from glsim.meshlimits import EXTENSIONS

_UNSAFE: Final = re.compile(r"[^A-Za-z0-9_+-]")
_NUMBER: Final = re.compile(r"(\d+)", re.ASCII)


def check_root(root: Path | str) -> Path:
    """The root, if it is a folder. Raises ConfigError."""
    root = Path(root)
    if not root.is_dir():
        what = "is a file, not a folder" if root.exists() else "there is no such folder"
        raise ConfigError(f"{root}: {what}; give the folder that holds the meshes")
    return root


class Words:
    """Makes path-safe words, each once."""

    def __init__(self) -> None:
        self._seen: Counter[str] = Counter()

    def unique(self, name: str) -> str:
        """A word for a name that no other name has."""
        word = _UNSAFE.sub("_", name)
        self._seen[word] += 1
        return word if self._seen[word] == 1 else f"{word}~{self._seen[word]}"


def listing(folder: Path) -> list[str]:
    """Names in natural order, without hidden ones. Raises ConfigError: not readable."""
    try:
        names = [path.name for path in folder.iterdir()]
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be listed ({error.strerror or error})") from None
    return sorted((name for name in names if not name.startswith(".")), key=natural)


def meshes(folder: Path, above: tuple[str, ...]) -> Iterator[Path]:
    """Mesh files of a folder, then of its sub-folders; ``above``: real paths on the way down."""
    real = os.path.realpath(folder)
    if real in above:
        return
    entries = [folder / name for name in listing(folder)]
    yield from (path for path in entries if is_mesh(path))
    for path in entries:
        if path.is_dir():
            yield from meshes(path, (*above, real))


def is_mesh(path: Path) -> bool:
    """Whether a file's name is that of a mesh."""
    return path.suffix.lower() in EXTENSIONS and not path.is_dir()


def last_number(stem: str) -> int | None:
    """The last run of digits in a name."""
    numbers = _NUMBER.findall(stem)
    return int(numbers[-1]) if numbers else None


def natural(name: str) -> tuple[list[tuple[int, int | str]], str]:
    """Sort key: runs of digits compare as numbers, so that "a2" comes before "a10"."""
    parts: list[tuple[int, int | str]] = [
        (0, int(part)) if part.isdigit() else (1, part.lower())
        for part in _NUMBER.split(name)
        if part
    ]
    return parts, name
