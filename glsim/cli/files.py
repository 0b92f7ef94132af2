"""Pictures that commands write."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.dataset.files import write_bytes


def write_picture(picture: NDArray[np.uint8], path: Path) -> None:
    """An 8-bit BGR array to a PNG file; complete or not at all. Raises DatasetError."""
    write_bytes(cv2.imencode(".png", picture)[1].tobytes(), path)
