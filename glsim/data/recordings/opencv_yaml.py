"""Matrices in the YAML files of OpenCV and iai_kinect2, matched as text.

OpenCV's own reader follows nested tables by recursion, and ends the process in deep ones.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import DatasetError
from glsim.core.files.regular import read_data
from glsim.measures.boards import find_corners

#: Largest file that is read, bytes: hundreds of times the size of a calibration or a board.
_MAX_BYTES = 1 << 20


_MATRIX = re.compile(
    r"""^["']?(\w{1,80})["']?:[ ]*!!opencv-matrix\s+rows:[ ]*(\d{1,6})\s+cols:[ ]*(\d{1,6})\s+"""
    r"""dt:[ ]*["']?[\w()]{1,20}["']?\s+data:\s*\[([^\]:]*)\]""",
    re.MULTILINE | re.ASCII,
)


def read_matrices(file: Path) -> dict[str, NDArray[np.float64]]:
    """Read the matrices of a YAML file that OpenCV wrote: name -> (rows, columns) float64.

    Raises DatasetError if the file cannot be read, or a matrix is not of finite numbers.
    """
    matrices = {}
    for name, rows, columns, numbers in _MATRIX.findall(_text(file)):
        try:
            values = np.array(numbers.replace(",", " ").split(), np.float64)
            matrices[name] = values.reshape(int(rows), int(columns))
            if not np.isfinite(values).all():
                raise ValueError
        except ValueError:
            raise DatasetError(
                f"{file}: {name} is not of {rows} x {columns} finite numbers: repair or remove it"
            ) from None
    return matrices


def board_corners(
    frame: DepthFrame, folder: Path, pattern: tuple[int, int]
) -> NDArray[np.float64] | None:
    """Return the corners of a chessboard, (N, 2) px, row by row; None without a board.

    They are read from iai_kinect2's file ``NNNN_ir_points.yaml`` beside a frame, or else found in
    its infrared image. Raises DatasetError.
    """
    file = folder / f"{frame.name.removesuffix('_depth')}_ir_points.yaml"
    if not file.is_file():
        return None if frame.infrared is None else find_corners(frame.infrared, pattern)
    numbers = re.findall(r"[-+]?\d+\.\d*(?:e[-+]?\d+)?", _text(file).partition("[")[2])
    if len(numbers) % 2 or len(numbers) < 8:
        raise DatasetError(f"{file}: holds no corners of a board (x, y of at least four)")
    return np.array(numbers, float).reshape(-1, 2)


def _text(file: Path) -> str:
    try:
        return read_data(file, _MAX_BYTES).decode()
    except UnicodeDecodeError:
        raise DatasetError(f"{file}: is no text: repair or remove it") from None
