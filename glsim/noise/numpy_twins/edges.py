"""Twins of the stages that read neighbouring pixels: lateral, edge_dropout and max_filter."""

from __future__ import annotations

import numpy as np

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.layers import Image, Parameters, fetch, mix, pixels, reasons_of_taken
from glsim.noise.numpy_twins.random import normal_pair, random_bits, uniform01
from glsim.noise.numpy_twins.values import angle_ratio, angle_to_axis

_MM = np.float32(0.001)


def lateral(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Samples the depth at a jittered position, which moves edges."""
    here = layers["depth"]
    x, y = pixels(view.window)
    growth = np.minimum(angle_ratio(angle_to_axis(layers["normal"])), np.float32(20.0))
    sigma = np.clip(p["sigma_px"] + p["angle_px"] * growth, 0.0, 4.0)
    first, second, _, _ = random_bits(x, y, view.seed, 0)
    at_x, at_y = (
        place.astype(np.float32) + np.clip(sigma * noise, -8.0, 8.0)
        for place, noise in zip((x, y), normal_pair(first, second), strict=True)
    )
    left, top = np.floor(at_x), np.floor(at_y)
    tx, ty = at_x - left, at_y - top
    column, row = left.astype(np.int64), top.astype(np.int64)
    d00, d10, d01, d11 = (
        fetch(here, view.window, column + dx, row + dy) for dy in (0, 1) for dx in (0, 1)
    )
    low = np.minimum(np.minimum(d00, d10), np.minimum(d01, d11))
    high = np.maximum(np.maximum(d00, d10), np.maximum(d01, d11))
    edge = _MM * p["edge_mm"]
    half = np.float32(0.5)
    blend = mix(mix(d00, d10, tx), mix(d01, d11, tx), ty)
    nearest = np.where(ty < half, np.where(tx < half, d00, d10), np.where(tx < half, d01, d11))
    depth = np.where((low > 0) & (high - low <= edge), blend, nearest)
    reason = reasons_of_taken(layers, depth, Reason.EDGE)
    moved = (depth > 0) & (here > 0) & (np.abs(depth - here) > edge)
    reason = np.where(moved, np.float32(Reason.MOVED), reason)
    return {"depth": depth, "reason": reason}


def edge_dropout(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels beside depth edges at random."""
    depth = layers["depth"]
    x, y = pixels(view.window)
    chosen = uniform01(random_bits(x, y, view.seed, 0)[0]) < p["probability"]
    step, reach = _MM * p["threshold_mm"], int(p["radius_px"])
    beside = np.zeros(depth.shape, np.bool_)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            there = fetch(depth, view.window, x + dx, y + dy)
            beside |= (there <= 0) | (np.abs(there - depth) > step)
    lost = (depth > 0) & chosen & beside
    return {
        "depth": np.where(lost, np.float32(0.0), depth),
        "reason": np.where(lost, np.float32(Reason.EDGE), layers["reason"]),
    }


def max_filter(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Takes the farthest depth of a square window."""
    here = layers["depth"]
    x, y = pixels(view.window)
    reach = int(p["radius_px"])
    depth = here
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            depth = np.maximum(depth, fetch(here, view.window, x + dx, y + dy))
    return {"depth": depth, "reason": reasons_of_taken(layers, depth, Reason.EDGE)}
