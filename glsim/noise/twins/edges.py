"""Twins of the stages at depth edges, and of structured light; they read neighbouring pixels."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from glsim.core.array_types import Whole
from glsim.core.arrays import Words, of
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import (
    Image,
    Layers,
    Parameters,
    around,
    disparity_px,
    fetch,
    mix,
    normal_pair,
    pixels,
    random_bits,
    reasons_of_taken,
    square,
    uniform01,
    without,
)
from glsim.noise.twins.values import angle_ratio, angle_to_axis

CELL_PX = 3
_CELLS = Layer("dot_match", "float", Fraction(1, CELL_PX))
_REACH_PX = 4  # half a 9x9 window
_REACH_CELLS = 2  # pixels within 4 px of a dot lie within two cells of the dot's cell


def lateral(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Samples the depth at a jittered position, which moves edges."""
    here = layers["depth"]
    xp, (x, y) = of(here), pixels(view.window, view.seed)
    growth = xp.minimum(angle_ratio(angle_to_axis(layers["normal"])), 20.0)
    sigma = xp.clip(p["sigma_px"] + p["angle_px"] * growth, 0.0, 4.0)
    first, second, _, _ = random_bits(x, y, view.seed, 0)
    at_x, at_y = (
        xp.floats(place) + xp.clip(sigma * noise, -8.0, 8.0)
        for place, noise in zip((x, y), normal_pair(first, second), strict=True)
    )
    left, top = xp.floor(at_x), xp.floor(at_y)
    tx, ty = at_x - left, at_y - top
    column, row = xp.integers(left), xp.integers(top)
    d00, d10, d01, d11 = (
        fetch(here, view.window, column + dx, row + dy) for dy in (0, 1) for dx in (0, 1)
    )
    low = xp.minimum(xp.minimum(d00, d10), xp.minimum(d01, d11))
    high = xp.maximum(xp.maximum(d00, d10), xp.maximum(d01, d11))
    edge = 0.001 * p["edge_mm"]
    blend = mix(mix(d00, d10, tx), mix(d01, d11, tx), ty)
    nearest = xp.where(ty < 0.5, xp.where(tx < 0.5, d00, d10), xp.where(tx < 0.5, d01, d11))
    depth = xp.where((low > 0) & (high - low <= edge), blend, nearest)
    reason = reasons_of_taken(layers, depth, Reason.EDGE)
    moved = (depth > 0) & (here > 0) & (xp.abs(depth - here) > edge)
    return {"depth": depth, "reason": xp.where(moved, float(Reason.MOVED), reason)}


def edge_dropout(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels beside depth edges at random."""
    depth, reach = layers["depth"], int(p["radius_px"])
    words = random_bits(*pixels(view.window, view.seed), view.seed, 0)[0]
    there, at_edge = around(view, depth, reach), depth <= 0
    for dx, dy in square(reach):
        other = there(dx, dy)
        at_edge = at_edge | (other <= 0) | (abs(other - depth) > 0.001 * p["threshold_mm"])
    return without(layers, (uniform01(words) < p["probability"]) & at_edge, Reason.EDGE)


def max_filter(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Replaces each depth by the largest depth in a square window."""
    depth, reach = layers["depth"], int(p["radius_px"])
    there = around(view, depth, reach)
    for dx, dy in square(reach):
        depth = of(depth).maximum(depth, there(dx, dy))
    return {"depth": depth, "reason": reasons_of_taken(layers, depth, Reason.EDGE)}


def dot_place(x: Words, y: Words) -> Whole:
    """Sample the pixel of a 3x3 cell where its dot lies: 0 to 8 in reading order."""
    place: Whole = (random_bits(x, y, 0xD075, 0)[0] % np.uint32(9)).astype(np.int64)
    return place


def place_pixel(x: Words, y: Words, place: Whole) -> tuple[Words, Words]:
    """Return the column and the row of pixel ``place`` (0 to 8) of the 3x3 cell (x, y)."""
    return x * CELL_PX + place % CELL_PX, y * CELL_PX + place // CELL_PX


def cells(window: Rect, around: int = 0) -> Rect:
    """Return the window of 3x3-pixel cells that covers a window, ``around`` cells wider."""
    left, top, width, height = _CELLS.window(window)
    more = 2 * around
    return Rect(left - around, top - around, width + more, height + more)


def correlation_window(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Matches each dot in a 9x9 window; returns 1 + its place in its cell, or 0 without a match."""
    wider = cells(view.window, _REACH_CELLS)
    place = dot_place(*pixels(wider))
    x, y = place_pixel(*pixels(wider), place)
    depth = fetch(layers["depth"], view.window, x, y)
    seen = depth > 0
    disparity = disparity_px(depth, view.focal_baseline_px_m)
    own = (slice(_REACH_CELLS, -_REACH_CELLS),) * 2
    dots, found, total, agree = (np.zeros(seen[own].shape, np.float32) for _ in range(4))
    neighbours = []
    # The neighbours of all cells are computed together: the same window, shifted by whole cells.
    height, width = seen[own].shape
    for left, top in square(_REACH_CELLS):
        row, column = _REACH_CELLS + top, _REACH_CELLS + left
        part = slice(row, row + height), slice(column, column + width)
        dx, dy = np.abs(x[part] - x[own]), np.abs(y[part] - y[own])
        near = np.maximum(dx, dy) <= _REACH_PX
        used = near & seen[part]
        dots += near
        found += used
        total += np.where(used, disparity[part], np.float32(0.0))
        squared = ((np.float32(1.2) * np.stack([dx, dy]).astype(np.float32)) ** 2).sum(axis=0)
        weight = np.reciprocal(np.where(squared > 0, squared, np.float32(1.0)))
        neighbours.append((used, disparity[part], weight))  # far dots may differ more
    share = p["min_share"]
    enough = found > share * dots
    mean = total / np.maximum(found, np.float32(1.0))
    for used, value, weight in neighbours:
        agree += used & (np.abs(value - mean) * weight < p["inlier_px"])
    match = seen[own] & enough & (agree > share * dots)
    return {"dot_match": np.where(match, place[own] + 1, 0).astype(np.float32)}


def dot_spread(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Gives each pixel the depth of the nearest matched dot, or 0."""
    window, here = view.window, layers["depth"]
    wider = cells(window, 1)
    match = fetch(layers["dot_match"], cells(window), *pixels(wider)).astype(np.int64)
    dot_x, dot_y = place_pixel(*pixels(wider), match - 1)
    value, surface = (fetch(layers[name], window, dot_x, dot_y) for name in ("depth", "clean"))
    x, y = pixels(window)
    column, row = x // CELL_PX - wider.left, y // CELL_PX - wider.top
    nearest = np.full(here.shape, p["radius_px"] * p["radius_px"], np.float32)
    depth, taken = (np.zeros(here.shape, np.float32) for _ in range(2))
    for dx, dy in square(1):
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
