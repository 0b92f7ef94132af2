"""Find the depth maps of one kind in a folder, which may hold other images of glsim too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from glsim.errors import ConfigError

#: Ends of the names of what glsim writes: the layers of frames, recordings, pictures for people.
_ENDINGS = (
    *("clean", "expected", "noisy", "infrared", "ir", "reason", "regions"),
    *("preview", "sigma", "figure"),
)
#: Pictures that carry no such ending.
_PICTURES = ("contact_sheet.png", "preview.png")


def depth_pngs(folder: Path, kind: Literal["clean", "noisy"]) -> tuple[list[Path], Counter[str]]:
    """Return the PNG files of a folder and its sub-folders that hold depth of one kind, sorted.

    Files whose names end as another layer's do, such as ``*_infrared.png``, are left out; names of
    the user's own are taken. The counter tells how many of which names were left out.
    Raises ConfigError if no file is left.
    """
    files, others = [], Counter[str]()
    for path in sorted(folder.rglob("*.png")):
        ending = path.stem.rpartition("_")[2] if "_" in path.stem else ""
        if path.name in _PICTURES:
            others[path.name] += 1
        elif ending in _ENDINGS and ending != kind:
            others[f"*_{ending}.png"] += 1
        else:
            files.append(path)
    if files:
        return files, others
    if others:
        raise ConfigError(
            f"{folder}: holds no {kind} depth maps, only {left_out_text(others)}: to take them all "
            f"the same, give a pattern such as '{folder}/*.png'"
        )
    shards = next(folder.glob("*.tar"), None)
    if shards is not None:
        raise ConfigError(f"{folder}: its frames are in shards ({shards.name}): give .png files")
    raise ConfigError(f"{folder}: holds no .png files")


def left_out(inputs: Sequence[Path], kind: Literal["clean", "noisy"]) -> Counter[str]:
    """Count what ``depth_pngs`` leaves out of those inputs that are folders."""
    total = Counter[str]()
    for path in inputs:
        if path.is_dir():
            total += depth_pngs(path, kind)[1]
    return total


def left_out_text(others: Counter[str]) -> str:
    """Return e.g. "4 *_clean.png, 4 *_infrared.png"."""
    return ", ".join(f"{count} {name}" for name, count in sorted(others.items()))
