"""Roots of face sets, path-safe names, and the numbers in names."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Final

from glsim.core.errors import ConfigError

_UNSAFE: Final = re.compile(r"[^A-Za-z0-9_+-]")
_NUMBER: Final = re.compile(r"(\d+)", re.ASCII)


def check_root(root: Path | str, kind: str = "folder") -> Path:
    """Return the root as a Path. Raises ConfigError if it is not a folder."""
    root = Path(root)
    if not root.is_dir():
        problem = "is a file, not a folder" if root.exists() else "there is no such folder"
        wanted = "meshes" if kind == "folder" else f"{kind} set"
        raise ConfigError(f"{root}: {problem}; give the folder that contains the {wanted}")
    return root


def unique_name(name: str, uses: Counter[str]) -> str:
    """Return ``name`` made path-safe, with a suffix "~2", "~3", ... if it was used before."""
    safe = _UNSAFE.sub("_", name)
    uses[safe] += 1
    return safe if uses[safe] == 1 else f"{safe}~{uses[safe]}"


def last_number(stem: str) -> int | None:
    """Return the last run of digits in a name as an integer; None if it has no digits."""
    numbers = _NUMBER.findall(stem)
    return int(numbers[-1]) if numbers else None
