"""Recordings with known noise, a chessboard and silhouettes, in the layout of iai_kinect2."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import encode_png
from tests.support.planted_frames import SHAPE, noisy, plane

Array = NDArray[np.float64]

#: Centre and size of a square of the board, px; 5 x 7 inner corners as iai_kinect2's.
BOARD_CENTRE = (205.0, 140.0)
SQUARE_PX = 18


def board_infrared() -> Array:
    """Draw the infrared image of a chessboard of 6 x 8 squares on a grey wall, (H, W) counts."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    across = (columns - BOARD_CENTRE[1]) / SQUARE_PX + 3.0
    down = (rows - BOARD_CENTRE[0]) / SQUARE_PX + 4.0
    squares = (across >= 0) & (across < 6) & (down >= 0) & (down < 8)
    margin = (across >= -1) & (across < 7) & (down >= -1) & (down < 9)
    dark = squares & ((np.floor(across) + np.floor(down)) % 2 == 1)
    return np.where(dark, 900.0, np.where(margin, 12_000.0, 4000.0))


def printed(infrared: Array, offset_mm: float) -> Array:
    """Return the depth error of a camera on dark print, (H, W) mm."""
    return np.where(infrared < 2000.0, offset_mm, 0.0)


def scene(step: bool = True) -> Array:
    """Return the depth, (H, W) mm, of a slanted plane at 0.8 m, with ``step`` beside a wall."""
    depth = plane(800.0, 0.1, 0.05)
    if step:
        depth[:, 300:] = 1950.0
        depth[:, 300:306] = 0.0
    return depth


def write_frame(
    folder: Path, name: str, depth: NDArray[np.uint16], infrared: NDArray[Any] | None = None
) -> None:
    """Write a frame as NAME_depth.png and NAME_ir.png."""
    write_atomic(encode_png(depth), folder / f"{name}_depth.png")
    if infrared is not None:
        counts = np.ascontiguousarray(np.rint(infrared)).astype(np.uint16)
        write_atomic(encode_png(counts), folder / f"{name}_ir.png")


def write_frames(
    folder: Path, depths: Iterable[NDArray[np.uint16]], infrared: NDArray[Any] | None = None
) -> Path:
    """Write the frames of a recording; return its folder."""
    for number, depth in enumerate(depths):
        write_frame(folder, f"{number:04d}", depth, None if infrared is None else infrared[number])
    return folder


def write_static_pair(folder: Path, clean: Array, sigma_mm: float, drift_mm: float = 0.0) -> None:
    """Write two frames of one view, of which the second has drifted."""
    infrared = board_infrared()
    for number in (0, 1):
        moved = np.where(clean > 0, clean + drift_mm * number, 0.0)
        depth = noisy(moved, sigma_mm, 1 + number)
        write_frame(folder, f"{number:04d}", depth, infrared)
