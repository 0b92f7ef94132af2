"""A user's recording of a static scene: a folder of 16-bit depth PNGs, or the files themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.depthfile import read_depth
from glsim.errors import ConfigError, DatasetError

#: Fewer frames say nothing about noise over time; ten say it within a quarter.
LEAST_FRAMES = 2


@dataclass(frozen=True, eq=False)
class Recording:
    """depth: (T, H, W) uint16 in steps of unit_mm, 0 = none. where: for messages."""

    depth: NDArray[np.uint16]
    unit_mm: float
    where: str


def read_recording(paths: Sequence[Path], unit_mm: float = 1.0) -> Recording:
    """All PNGs of the folders and files, in the order of their names.

    Raises ConfigError for paths that cannot be a recording, DatasetError for files that are not
    16-bit depth maps of one size, or hold no depth at all.
    """
    if not unit_mm > 0:
        raise ConfigError(f"--depth-unit-mm {unit_mm:g}: must be above 0")
    files = [file for path in paths for file in _files(path)]
    where = str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
    if len(files) < LEAST_FRAMES:
        raise DatasetError(
            f"{where}: has one frame only; noise shows between frames: record at least 30 of a "
            "scene in which nothing moves"
        )
    frames: list[NDArray[np.uint16]] = []
    for file in files:
        frame = read_depth(file)
        if frames and frame.shape != frames[0].shape:
            raise DatasetError(
                f"{file}: is {_size(frame)}, but {files[0].name} is {_size(frames[0])}: give "
                "frames of one camera in one mode"
            )
        frames.append(frame)
    depth = np.stack(frames)
    if not depth.any():
        raise DatasetError(f"{where}: no pixel of any frame has depth (all are 0)")
    return Recording(depth, unit_mm, where)


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise ConfigError(f"{path}: no such file or folder")
    files = sorted(path.glob("*.png"))
    if not files:
        raise DatasetError(f"{path}: holds no .png files; give the folder of a recording")
    return files


def _size(frame: NDArray[np.uint16]) -> str:
    return f"{frame.shape[1]}x{frame.shape[0]}"
