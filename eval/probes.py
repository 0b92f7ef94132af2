"""Trivial predictions, scored beside the methods so that a reader can read an MSE."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.errors import DatasetError

from .frames import Frames
from .types import Depth


def shifted(depth: Depth, columns: int) -> Depth:
    """Moved to the right; what comes in has no depth."""
    moved = np.zeros_like(depth)
    moved[:, columns:] = depth[:, : depth.shape[1] - columns]
    return moved


def eroded(depth: Depth, pixels: int) -> Depth:
    """With ``pixels`` fewer at each silhouette."""
    kernel = np.ones((2 * pixels + 1,) * 2, np.uint8)
    inside = cv2.erode((depth > 0).astype(np.uint8), kernel) > 0
    return np.where(inside, depth, np.float32(0))


#: Name -> prediction from (clean, mean face); None where there is no mean face.
PROBES: Final[dict[str, Callable[[Depth, Depth | None], Depth | None]]] = {
    "zero image": lambda clean, mean: np.zeros_like(clean),
    "mean face": lambda clean, mean: mean,
    "clean, eroded 1 px": lambda clean, mean: eroded(clean, 1),
    "clean, eroded 2 px": lambda clean, mean: eroded(clean, 2),
    "clean, eroded 4 px": lambda clean, mean: eroded(clean, 4),
    "clean, shifted 1 px": lambda clean, mean: shifted(clean, 1),
}

#: Frames on which probes are scored, evenly spread; they are there to be read, not to be compared.
MOST_FRAMES: Final = 200


def mean_face(frames: Frames) -> Depth | None:
    """(H, W) mean of the clean frames where most of them have depth; None if sizes differ.

    Over at most MOST_FRAMES frames, evenly spread: one more changes no digit of what it is for.
    """
    total: NDArray[np.float64] | None = None
    count, used = np.zeros(0), 0
    for number in range(0, len(frames), max(1, len(frames) // MOST_FRAMES)):
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
