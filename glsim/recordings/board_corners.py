"""The corners of chessboards that a recording states, or that its infrared shows."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.errors import DatasetError
from glsim.measures.boards import find_corners
from glsim.measures.frame import DepthFrame


def read_corners(file: Path) -> NDArray[np.float64]:
    """Read ``NNNN_ir_points.yaml`` of iai_kinect2: (N, 2) px, row by row. Raises DatasetError."""
    text = file.read_text().partition("[")[2]
    numbers = re.findall(r"[-+]?\d+\.\d*(?:e[-+]?\d+)?", text)
    if len(numbers) % 2 or len(numbers) < 8:
        raise DatasetError(f"{file}: holds no corners of a board (x, y of at least four)")
    return np.array(numbers, float).reshape(-1, 2)


def board_corners(
    frame: DepthFrame, folder: Path, pattern: tuple[int, int]
) -> NDArray[np.float64] | None:
    """Return the corners, (N, 2) px, of the file beside a frame, else those in its infrared."""
    file = folder / f"{frame.name.removesuffix('_depth')}_ir_points.yaml"
    if file.is_file():
        return read_corners(file)
    return None if frame.infrared is None else find_corners(frame.infrared, pattern)
