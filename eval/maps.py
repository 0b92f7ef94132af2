"""Depth maps without a truth, as the command ``denoise`` takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from glsim.camera import Intrinsics
from glsim.dataset.files import read_json
from glsim.dataset.layout import HEADER
from glsim.depthfile import read_depth
from glsim.errors import ConfigError, DatasetError

from .frames import Key, Sample, check_millimetres


class MapFrames:
    """Files as frames whose truth is unknown: those of one folder are a sequence."""

    identity = ""
    regions: Mapping[str, int] = {}

    def __init__(self, files: Sequence[Path], depth_unit_mm: float) -> None:
        self._files, self._unit_mm = files, depth_unit_mm

    def __len__(self) -> int:
        return len(self._files)

    def key(self, number: int) -> Key:
        """The folder is the sequence."""
        return Key(str(self._files[number].parent), "", number)

    def load(self, number: int) -> Sample:
        """The map stands for its own truth. DatasetError for what is no 16-bit depth map."""
        file = self._files[number]
        depth = read_depth(file) * np.float32(self._unit_mm)
        check_millimetres(depth, str(file))
        height, width = depth.shape
        return Sample(depth, depth, Intrinsics(width, height, 1.0, 1.0, 0.0, 0.0))


def unit_mm(files: Sequence[Path], given: float | None) -> float:
    """The step of depth files: what the data sets that they lie in say, else ``given``, else 1.

    Raises ConfigError where those differ. Reading a data set in steps of 0.1 mm as millimetres
    would put every face ten times too far away, and nothing would look wrong.
    """
    stated = {unit for folder in {file.parent for file in files} if (unit := _stated(folder))}
    if len(stated) > 1:
        raise ConfigError("the maps are of data sets with different steps: denoise them one by one")
    if stated and given is not None and {given} != stated:
        raise ConfigError(
            f"--depth-unit-mm {given:g}: the data set of these maps has steps of "
            f"{min(stated):g} mm: leave the option out"
        )
    return stated.pop() if stated else given or 1.0


def _stated(folder: Path) -> float | None:
    """By the data set that a folder is part of, if it is."""
    for place in (folder, *folder.absolute().parents):
        if (place / HEADER).is_file():
            with suppress(DatasetError):  # a file of that name may be somebody else's
                unit = read_json(place / HEADER).get("depth_unit_mm")
                return float(unit) if isinstance(unit, int | float) else None
    return None


def _matching(pattern: Path) -> list[Path]:
    """The files that a quoted pattern stands for."""
    relative = pattern.relative_to(pattern.anchor)
    return sorted(Path(pattern.anchor or ".").glob(str(relative))) if relative.parts else []


def find_maps(inputs: Sequence[str], out: Path) -> list[tuple[Path, Path]]:
    """(input, output) for files, folders (all PNGs, sub-folders too) and patterns.

    Raises ConfigError where there is nothing, where two would have the same output, and where an
    input would be overwritten.
    """
    pairs: list[tuple[Path, Path]] = []
    for text in inputs:
        path = Path(text)
        if path.is_dir():
            found = sorted(path.rglob("*.png"))
            pairs += [(file, out / file.relative_to(path)) for file in found]
        else:
            found = [path] if path.is_file() else _matching(path)
            pairs += [(file, out / file.name) for file in found]
        if not found:
            raise ConfigError(f"{text}: no such file, folder of .png files, or pattern")
    if len(pairs) == 1 and not out.is_dir() and not Path(inputs[0]).is_dir():
        if out.suffix.lower() != ".png":
            raise ConfigError(f"-o {out}: give a name that ends in .png, or an existing folder")
        pairs = [(pairs[0][0], out)]
    elif out.is_file():
        raise ConfigError(f"-o {out}: is a file; for several maps give a folder")
    targets = [target for _, target in pairs]
    if len(set(targets)) != len(targets):
        raise ConfigError(f"-o {out}: several maps have the same name: denoise folder by folder")
    for source, target in pairs:
        if target.exists() and target.samefile(source):
            raise ConfigError(f"-o {out}: would overwrite {source}")
    return pairs
