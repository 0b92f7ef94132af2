"""Twins of shaders/lib/layers.glsl and of GLSL built-ins: pixel coordinates, fetches, mix."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import Layers

Image = NDArray[np.float32]
#: Parameter values by their GLSL names.
Parameters = Mapping[str, np.float32]


def pixels(window: Rect) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns (1, w) and rows (h, 1) of the window's pixels, in the frame."""
    x = np.arange(window.left, window.left + window.width)
    y = np.arange(window.top, window.top + window.height)
    return x[None, :], y[:, None]


def fetch(layer: Image, window: Rect, x: NDArray[np.int64], y: NDArray[np.int64]) -> Image:
    """Read a layer at integer pixels of the frame (x and y broadcast); 0 outside its window."""
    column, row = x - window.left, y - window.top
    inside = (column >= 0) & (column < window.width) & (row >= 0) & (row < window.height)
    nearest = np.clip(row, 0, window.height - 1), np.clip(column, 0, window.width - 1)
    return np.where(inside, layer[nearest], np.float32(0.0))


def mix(a: Image, b: Image, t: Image) -> Image:
    """Interpolate linearly from ``a`` at t = 0 to ``b`` at t = 1."""
    mixed: Image = a + t * (b - a)
    return mixed


def reasons_of_taken(layers: Layers, depth_m: Image, lost: Reason) -> Image:
    """Reasons after pixels took their depth from others; ``lost``: where the new depth is 0."""
    here, reason = layers["depth"], layers["reason"]
    new = np.where(layers["clean"] > 0, np.float32(Reason.MOVED), np.float32(Reason.GROWN))
    reason = np.where((depth_m <= 0) & (here > 0), np.float32(lost), reason)
    return np.where((depth_m > 0) & (here <= 0), new, reason)
