"""Twin of shaders/lib/dots.glsl: the projected pattern, one dot per 3x3 cell."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.noise.numpy_twins.random import random_bits

CELL_PX = 3
_CELLS = Layer("dot_match", "float", Fraction(1, CELL_PX))

Whole = NDArray[np.int64]


def dot_place(x: Whole, y: Whole) -> Whole:
    """The pixel of a cell that has the dot, 0 to 8 in reading order. Arguments broadcast."""
    return (random_bits(x, y, 0xD075, 0)[0] % np.uint32(9)).astype(np.int64)


def place_pixel(x: Whole, y: Whole, place: Whole) -> tuple[Whole, Whole]:
    """Column and row, in the frame, of the pixel ``place`` of cell (x, y)."""
    return x * CELL_PX + place % CELL_PX, y * CELL_PX + place // CELL_PX


def cells(window: Rect, around: int = 0) -> Rect:
    """The cells that a window (pixels) touches, widened by ``around`` cells on each side."""
    left, top, width, height = _CELLS.window(window)
    more = 2 * around
    return Rect(left - around, top - around, width + more, height + more)
