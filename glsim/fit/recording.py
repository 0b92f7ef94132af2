"""Read a recording of a static scene: a folder of 16-bit depth PNGs, or the files themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, DatasetError
from glsim.files.png import read_depth_png

#: Minimum number of frames: noise over time needs two. With ten its error is about a quarter.
LEAST_FRAMES = 2


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames of one camera: depth (T, H, W) uint16 in steps of unit_mm, 0 = no depth.

    where: names the files in messages.
    """

    depth: NDArray[np.uint16]
    unit_mm: float
    where: str


def read_recording(paths: Sequence[Path], unit_mm: float = 1.0) -> Recording:
    """Read PNG files, and all PNG files of folders in the order of their names.

    unit_mm: step of the depth files. Raises ConfigError for a path that does not exist or a step
    of 0 or less; DatasetError for fewer than two frames, files that are not 16-bit depth maps of
    one size, or a recording without any depth.
    """
    if not unit_mm > 0:
        raise ConfigError(f"--depth-unit-mm {unit_mm:g}: must be above 0")
    files = [file for path in paths for file in _files(path)]
    where = str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
    if len(files) < LEAST_FRAMES:
        raise DatasetError(
            f"{where}: has one frame only; noise is measured between frames: record at least 30 "
            "frames of a scene in which nothing moves"
        )
    frames: list[NDArray[np.uint16]] = []
    for file in files:
        frame = read_depth_png(file)
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
