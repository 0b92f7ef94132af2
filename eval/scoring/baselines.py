"""Trivial predictions, whose scores show how much an MSE is worth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import Frames
from glsim.core.errors import DatasetError
from glsim.denoise.interface import Depth


def _eroded(depth: Depth, pixels: int) -> Depth:
    """Remove a band of ``pixels`` px along the silhouette from a depth map."""
    kernel = np.ones((2 * pixels + 1,) * 2, np.uint8)
    inside = cv2.erode((depth > 0).astype(np.uint8), kernel) > 0
    return np.where(inside, depth, np.float32(0))


#: Name -> function of (clean, mean face) that returns a prediction, or None without a mean face.
TRIVIAL_BASELINES: Final[dict[str, Callable[[Depth, Depth | None], Depth | None]]] = {
    "zero image": lambda clean, _: np.zeros_like(clean),
    "mean face": lambda _, mean: mean,
    "clean, eroded 1 px": lambda clean, _: _eroded(clean, 1),
    "clean, eroded 2 px": lambda clean, _: _eroded(clean, 2),
    "clean, eroded 4 px": lambda clean, _: _eroded(clean, 4),
    "clean, shifted 1 px": lambda clean, _: np.pad(clean[:, :-1], ((0, 0), (1, 0))),
}

#: Largest number of frames, evenly spread, for baselines: only their magnitude matters.
BASELINE_FRAMES: Final = 200


def mean_face(frames: Frames) -> Depth | None:
    """Average clean frames where most of them have depth: (H, W) mm; None if sizes differ.

    It uses about BASELINE_FRAMES frames, evenly spread; more would not change it noticeably.
    """
    total: NDArray[np.float64] | None = None
    count, used = np.zeros(0), 0
    for number in range(0, len(frames), max(1, len(frames) // BASELINE_FRAMES)):
        try:
            clean = frames.load(number).clean_mm
        except DatasetError:
            continue
        if total is None:
            total, count = np.zeros(clean.shape), np.zeros(clean.shape)
        if clean.shape != total.shape:
            return None
        total += clean
        count += clean > 0
        used += 1
    if total is None:
        return None
    mean = np.zeros(total.shape, np.float32)
    np.divide(total, count, out=mean, where=2 * count > used, casting="same_kind")
    return mean
