"""Read a recording of a static scene: 16-bit depth PNGs and, if there are any, infrared PNGs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, DatasetError
from glsim.files.png import read_depth_png

#: Minimum number of frames: noise over time needs two. With ten its error is about a quarter.
LEAST_FRAMES = 2

#: Ends of the names of pairs in one folder: NNNN_depth.png and NNNN_ir.png.
DEPTH_SUFFIX, INFRARED_SUFFIX = "_depth.png", "_ir.png"

#: A static scene changes by noise only. Two frames show different scenes if their median absolute
#: difference is above _MOST_MEDIAN_MM and pixels _APART_PX apart change alike (correlation above
#: _MOST_ALIKE), or if that median is above _MOST_SHARE of the depth. Measured on 44 frames of a
#: real Kinect V2: its one static pair 2 mm, 0.04, 0.3 %; other pairs at least 15 mm, 0.63, 1.3 %.
_MOST_MEDIAN_MM = 3.0
_APART_PX = 8
_MOST_ALIKE = 0.3
_MOST_SHARE = 0.05
_LEAST_COMMON_PX = 100


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames of one camera: depth (T, H, W) uint16 in steps of unit_mm, 0 = no depth.

    where: names the files in messages. infrared: (T, H, W) uint16 counts of the same frames, or
    None.
    """

    depth: NDArray[np.uint16]
    unit_mm: float
    where: str
    infrared: NDArray[np.uint16] | None = None


def read_recording(
    paths: Sequence[Path], unit_mm: float = 1.0, infrared: Path | None = None
) -> Recording:
    """Read PNG files, and all PNG files of folders in the order of their names.

    A folder that holds NNNN_depth.png is read as pairs with NNNN_ir.png. unit_mm: step of the
    depth files. infrared: a folder of infrared PNGs, one for each depth file in the order of their
    names. Raises ConfigError for a path that does not exist or a step of 0 or less; DatasetError
    for fewer than two frames, files that are not 16-bit images of one size, infrared images
    without their depth map or the reverse, a recording without any depth, or one of a scene that
    is not static.
    """
    if not unit_mm > 0:
        raise ConfigError(f"--depth-unit-mm {unit_mm:g}: must be above 0")
    files = [file for path in paths for file in _depth_files(path)]
    where = str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
    if len(files) < LEAST_FRAMES:
        raise DatasetError(
            f"{where}: has one frame only; noise is measured between frames: record at least 30 "
            "frames of a scene in which nothing moves"
        )
    depth = _stack(files)
    if not depth.any():
        raise DatasetError(f"{where}: no pixel of any frame has depth (all are 0)")
    _check_static(depth, unit_mm, files)
    lights = _infrared_files(files, infrared)
    light = _stack([files[0], *lights])[1:] if lights else None
    return Recording(depth, unit_mm, where, light)


def _depth_files(path: Path) -> list[Path]:
    """List a file, or the depth files of a folder."""
    if path.is_file():
        return [path]
    files = _png_files(path)
    return [file for file in files if file.name.endswith(DEPTH_SUFFIX)] or files


def _infrared_files(depth_files: Sequence[Path], folder: Path | None) -> list[Path]:
    """List the infrared file of each depth file; none if the recording has no infrared."""
    if folder is not None:
        files = _png_files(folder)
        files = [file for file in files if file.name.endswith(INFRARED_SUFFIX)] or files
        if len(files) != len(depth_files):
            raise DatasetError(
                f"{folder}: holds {len(files)} infrared images for {len(depth_files)} depth maps: "
                "give one for each, named in the same order"
            )
        return files
    pairs = [
        file.with_name(file.name.removesuffix(DEPTH_SUFFIX) + INFRARED_SUFFIX)
        for file in depth_files
        if file.name.endswith(DEPTH_SUFFIX)
    ]
    found = [file for file in pairs if file.is_file()]
    if found and len(found) != len(depth_files):
        missing = next((file for file in pairs if not file.is_file()), depth_files[0])
        raise DatasetError(
            f"{missing}: no such file, but other frames have infrared: give it for all or for none"
        )
    return found


def _png_files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such file or folder")
    files = sorted(folder.glob("*.png"))
    if not files:
        raise DatasetError(f"{folder}: holds no .png files; give the folder of a recording")
    return files


def _stack(files: Sequence[Path]) -> NDArray[np.uint16]:
    """Read 16-bit PNGs of one size: (len(files), H, W)."""
    frames: list[NDArray[np.uint16]] = []
    for file in files:
        frame = read_depth_png(file)
        if frames and frame.shape != frames[0].shape:
            raise DatasetError(
                f"{file}: is {_size(frame)}, but {files[0].name} is {_size(frames[0])}: give "
                "frames of one camera in one mode"
            )
        frames.append(frame)
    return np.stack(frames)


def _size(frame: NDArray[np.uint16]) -> str:
    return f"{frame.shape[1]}x{frame.shape[0]}"


def _check_static(depth: NDArray[np.uint16], unit_mm: float, files: Sequence[Path]) -> None:
    """Raise DatasetError for the first two successive frames that show different scenes."""
    for (before, first), (after, second) in pairwise(zip(depth, files, strict=True)):
        common = (before > 0) & (after > 0)
        seen = min(int((before > 0).sum()), int((after > 0).sum()))
        change = (after.astype(np.float64) - before) * unit_mm
        reason = ""
        if common.sum() < max(_LEAST_COMMON_PX, 0.5 * seen) and seen >= _LEAST_COMMON_PX:
            reason = f"only {int(common.sum())} pixels have depth in both"
        elif common.sum() >= _LEAST_COMMON_PX:
            median_mm = float(np.median(np.abs(change[common])))
            share = median_mm / float(np.median(before[common]) * unit_mm)
            alike = _likeness(change, common, median_mm)
            if share > _MOST_SHARE or (median_mm > _MOST_MEDIAN_MM and alike > _MOST_ALIKE):
                reason = f"half of the pixels change by more than {median_mm:.0f} mm"
        if reason:
            raise DatasetError(
                f"{first.name} and {second.name} show different scenes ({reason}): fit needs a "
                "static recording, one camera and nothing that moves"
            )


def _likeness(change: NDArray[np.float64], common: NDArray[np.bool_], median_mm: float) -> float:
    """Correlate the clipped changes of pixels _APART_PX apart: 0 for noise, near 1 for motion."""
    limit = 5.0 * max(median_mm, 0.5)
    # Noise that differs from place to place has no sign in common; motion has.
    part = np.where(common, np.clip(change, -limit, limit), 0.0)
    power = float((part**2).sum() / max(common.sum(), 1))
    products = []
    for axis in (0, 1):
        a, valid = np.moveaxis(part, axis, 0), np.moveaxis(common, axis, 0)
        both = valid[_APART_PX:] & valid[:-_APART_PX]
        products.append(float((a[_APART_PX:] * a[:-_APART_PX]).sum() / max(both.sum(), 1)))
    return float(np.mean(products)) / power if power > 0 else 0.0
