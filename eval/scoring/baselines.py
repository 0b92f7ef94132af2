"""Trivial predictions, whose scores show how good an MSE is."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.depth_frame import Frames
from glsim.core.errors import DatasetError


def trivial_predictions(clean: Depth, mean: Depth | None) -> dict[str, Depth]:
    """Return name -> trivial prediction; the mean face is left out if its size differs."""
    predictions = {"zero image": np.zeros_like(clean)}
    if mean is not None and mean.shape == clean.shape:
        predictions["mean face"] = mean
    return predictions


#: Largest number of frames (evenly spread) on which baselines are scored; a rough mean is enough.
BASELINE_FRAMES: Final = 200


def mean_face(frames: Frames) -> Depth | None:
    """Average clean frames, mm, 0 where fewer than half have depth; None if sizes differ."""
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
