"""Find the depth maps of one kind in a folder, which may hold other images of glsim too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from glsim.errors import ConfigError

#: Ends of the names of what glsim writes: the layers of frames, recordings, pictures for people.
_ENDINGS = (
    *("clean", "expected", "normals", "noisy", "infrared", "ir", "reason", "regions"),
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
        if other := other_kind(path.name, kind):
            others[other] += 1
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


def other_kind(name: str, kind: Literal["clean", "noisy"]) -> str:
    """Return what a PNG file's name says it is, as a pattern, if it is no depth of that kind."""
    stem = name.removesuffix(".png")
    ending = stem.rpartition("_")[2] if "_" in stem else ""
    if name in _PICTURES:
        return name
    return f"*_{ending}.png" if ending in _ENDINGS and ending != kind else ""


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
