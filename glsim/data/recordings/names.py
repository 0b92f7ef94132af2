"""Names of depth maps, their infrared images, and other images in the same folder."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, get_args

from glsim.core.errors import ConfigError, counted
from glsim.core.files.listing import entries

#: Kind of depth map that a command reads; other kinds in a folder are left out.
DepthKind = Literal["clean", "noisy", "expected"]
DEPTH_LAYERS: Final = get_args(DepthKind)

#: Words that mark other images. Numbers are ignored; the last word of a name counts, or the first
#: if the last is not "depth": rgb_0001.png, 0001-color.png, frame-000000.normal.png.
_OTHERS = (
    *DEPTH_LAYERS, "infrared", "nir", "ir", "reason", "regions", "preview", "sigma",
    "figure", "color", "colour", "rgb", "rgba", "amplitude", "confidence", "conf", "mask", "normal",
    "normals", "instance", "instances", "semantic", "semantics", "segmentation", "seg", "label",
    "labels", "disparity", "flow", "albedo", "alpha", "uncertainty", "variance",
)  # fmt: skip
_SEPARATOR = re.compile(r"[_.*/-]+")
#: Names of other pictures of glsim, which have no such word.
_PICTURES = ("contact_sheet.png", "preview.png")
#: Pairs of endings: of a depth map's name, and of its infrared image's name.
_INFRARED_BESIDE = (
    ("_depth", "_ir"), ("_noisy", "_infrared"), ("", "_ir"), ("", "_infrared"), ("depth", "ir"),
    ("depth", "infrared"),
)  # fmt: skip
_INFRARED_FOLDERS = ("ir", "infrared")


def words_of(name: str) -> list[str]:
    """Return the words of a file's name without its suffix, in lower case, without numbers."""
    words = _SEPARATOR.split(name.rpartition(".")[0].lower())
    return [word for word in words if word and not word.isdigit()]


def other_kind(name: str, kind: DepthKind) -> str:
    """Return the pattern of a file's name if the name marks another kind of image; else ""."""
    suffix, words = name.rpartition(".")[2], words_of(name)
    if name in _PICTURES:
        return name
    if not words or words[-1] == kind:
        return ""
    first = words[0] in _OTHERS and words[-1] != "depth"
    if first and name.lower().startswith(words[0]):
        return name if name.lower() == f"{words[0]}.{suffix}" else f"{words[0]}_*.{suffix}"
    last = words[-1] in _OTHERS or words[-2:] == ["infrared", "right"]
    return f"*_{words[-1]}.{suffix}" if last else ""


def is_infrared(name: str) -> bool:
    """Return whether a file's name, or a pattern of ``other_kind``, marks infrared images."""
    return not {"ir", "infrared"}.isdisjoint(words_of(name))


def left_out_text(others: Counter[str]) -> str:
    """Return the left-out patterns as text, such as "4 *_clean.png, 4 *_infrared.png"."""
    return ", ".join(f"{count} {name}" for name, count in sorted(others.items()))


def note_of_others(others: Counter[str], given: Path | str) -> str:
    """Say which given files count as depth despite their names. Raises ConfigError for infrared."""
    text = left_out_text(others)
    if any(map(is_infrared, others)):
        raise ConfigError(f"{given}: named as infrared, not depth: {text}: give the depth maps")
    return f"taken for depth as named: {text}"


def infrared_beside(depth_file: Path) -> Path | None:
    """Return the infrared image beside a depth file, or in a folder ``ir`` beside ``depth``."""
    stem, suffix = depth_file.stem, depth_file.suffix
    names = [
        stem.removesuffix(depth) + light
        for depth, light in _INFRARED_BESIDE
        if stem.endswith(depth)
    ]
    if stem.startswith("depth"):
        names += [light + stem.removeprefix("depth") for light in _INFRARED_FOLDERS]
    found = [depth_file.with_name(name + suffix) for name in names]
    if suffix == ".depth":
        found.append(depth_file.with_suffix(".ir"))
    if depth_file.parent.name == "depth":
        for folder in _INFRARED_FOLDERS:
            place = depth_file.parent.with_name(folder)
            found += [place / depth_file.name, place / (stem.replace("depth", folder) + suffix)]
    return next((file for file in found if file != depth_file and file.is_file()), None)


def infrared_files(depth_files: Sequence[Path], given: Path) -> list[Path]:
    """Return the infrared image of each depth file.

    Args:
        depth_files: in the order of their names.
        given: the image of a single depth file, or a folder. Its images have the names of the depth
            files; or there are equally many, in the same order.

    Raises ConfigError: there is no such folder, or the numbers of images differ.
    """
    if given.is_file() and len(depth_files) == 1:
        return [given]
    if not given.is_dir():
        raise ConfigError(f"--infrared {given}: no such folder")
    same = [given / file.name for file in depth_files]
    if all(file.is_file() for file in same):
        return same
    names, _ = entries(given, (depth_files[0].suffix.lower(),))
    named = [name for name in names if Path(name).stem.endswith(("_ir", "_infrared"))]
    files = [given / name for name in named or names]
    if len(files) != len(depth_files):
        raise ConfigError(
            f"{given}: holds {counted(len(files), 'infrared image')} for "
            f"{counted(len(depth_files), 'depth map')}: "
            "give one for each, named in the same order"
        )
    return files
