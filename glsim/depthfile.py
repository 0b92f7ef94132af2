"""A user's own depth map: a 16-bit PNG of one channel."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.errors import DatasetError


def read_depth(path: Path) -> NDArray[np.uint16]:
    """A 16-bit single-channel PNG. Raises DatasetError for anything else."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from None
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise DatasetError(f"{path}: is no readable image")
    if image.dtype != np.uint16 or image.ndim != 2:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise DatasetError(
            f"{path}: has {channels} channels of {image.dtype.itemsize * 8} bits; a depth map has "
            "one of 16 bits, in millimetres (or --depth-unit-mm)"
        )
    depth: NDArray[np.uint16] = image
    return depth
