"""Pictures and depth maps that commands read and write."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.dataset.files import write_file, writing


def write_picture(picture: NDArray[np.uint8], path: Path) -> None:
    """An 8-bit BGR array to a PNG file; complete or not at all. Raises DatasetError."""
    write_bytes(cv2.imencode(".png", picture)[1].tobytes(), path)


def write_bytes(data: bytes, path: Path) -> None:
    """A file, complete or not at all; its folder is made. Raises DatasetError."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, data, path.with_name(f".{path.name}.{os.getpid()}"))
