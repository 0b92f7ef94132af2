"""The corners of chessboards that a recording states, or that its infrared shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.boards import find_corners
from glsim.core.depth_frame import DepthFrame
from glsim.data.recordings.opencv_yaml import read_corners


def board_corners(
    frame: DepthFrame, folder: Path, pattern: tuple[int, int]
) -> NDArray[np.float64] | None:
    """Return the corners, (N, 2) px, of the file beside a frame, else those in its infrared."""
    file = folder / f"{frame.name.removesuffix('_depth')}_ir_points.yaml"
    if file.is_file():
        return read_corners(file)
    return None if frame.infrared is None else find_corners(frame.infrared, pattern)
