"""Twins of the stages of structured light: correlation_window and dot_spread."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.depth import disparity_px
from glsim.noise.numpy_twins.dots import CELL_PX, cells, dot_place, place_pixel
from glsim.noise.numpy_twins.layers import Image, Parameters, fetch, pixels, reasons_of_taken

_REACH_PX = 4  # 9x9
_REACH_CELLS = 2  # pixels within 4 px of a dot lie within two cells of its cell


def correlation_window(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Matches each dot in a 9x9 window: 1 + its place in its cell, 0 if not matched."""
    around = cells(view.window, _REACH_CELLS)
    place = dot_place(*pixels(around))
    x, y = place_pixel(*pixels(around), place)
    depth = fetch(layers["depth"], view.window, x, y)
    seen = depth > 0
    disparity = disparity_px(depth, view.focal_baseline_px_m)
    own = (slice(_REACH_CELLS, -_REACH_CELLS),) * 2
    dots, found, total, agree = (np.zeros(seen[own].shape, np.float32) for _ in range(4))
    neighbours = []
    for part in _shifts(around.height, around.width):
        dx, dy = np.abs(x[part] - x[own]), np.abs(y[part] - y[own])
        near = np.maximum(dx, dy) <= _REACH_PX
        used = near & seen[part]
        dots += near
        found += used
        total += np.where(used, disparity[part], np.float32(0.0))
        neighbours.append((used, disparity[part], _weight(dx, dy)))
    share = p["min_share"]
    enough = found > share * dots
    mean = total / np.maximum(found, np.float32(1.0))
    for used, value, weight in neighbours:
        agree += used & (np.abs(value - mean) * weight < p["inlier_px"])
    match = seen[own] & enough & (agree > share * dots)
    return {"dot_match": np.where(match, place[own] + 1, 0).astype(np.float32)}


def dot_spread(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Gives each pixel the depth of the nearest matched dot, or none."""
    window, here = view.window, layers["depth"]
    around = cells(window, 1)
    match = fetch(layers["dot_match"], cells(window), *pixels(around)).astype(np.int64)
    dot_x, dot_y = place_pixel(*pixels(around), match - 1)
    value, surface = (fetch(layers[name], window, dot_x, dot_y) for name in ("depth", "clean"))
    x, y = pixels(window)
    column, row = x // CELL_PX - around.left, y // CELL_PX - around.top
    nearest = np.full(here.shape, p["radius_px"] * p["radius_px"], np.float32)
    depth, taken = (np.zeros(here.shape, np.float32) for _ in range(2))
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            at = row + dy, column + dx
            offset_x, offset_y = dot_x[at] - x, dot_y[at] - y
            squared = (offset_x * offset_x + offset_y * offset_y).astype(np.float32)
            closer = (match[at] > 0) & (squared < nearest)
            nearest = np.where(closer, squared, nearest)
            depth = np.where(closer, value[at], depth)
            taken = np.where(closer, surface[at], taken)
    reason, own = reasons_of_taken(layers, depth, Reason.WINDOW), layers["clean"]
    other = (own > 0) & (taken > 0) & (np.abs(taken - own) > np.float32(0.001) * p["edge_mm"])
    moved = other & (depth > 0) & (here > 0)
    return {"depth": depth, "reason": np.where(moved, np.float32(Reason.MOVED), reason)}


def _weight(dx: NDArray[np.int64], dy: NDArray[np.int64]) -> Image:
    """Weight of a dot's deviation by its offset from the centre, px: farther dots count less."""
    x, y = np.float32(1.2) * dx.astype(np.float32), np.float32(1.2) * dy.astype(np.float32)
    squared = x * x + y * y
    return np.reciprocal(np.where(squared > 0, squared, np.float32(1.0)))


def _shifts(height: int, width: int) -> Iterator[tuple[slice, slice]]:
    """Slices of the inner part's size, shifted by whole cells, in the shader's order."""
    reach = 2 * _REACH_CELLS
    for top in range(reach + 1):
        for left in range(reach + 1):
            yield slice(top, height - reach + top), slice(left, width - reach + left)
