"""Twins of the stages of returned light and range: infrared, low_signal, shadow, range_gate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.layers import Image, Parameters, pixels
from glsim.noise.numpy_twins.random import normal_pair, random_bits


def infrared(_view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Returned infrared light, by Lambert's law and the inverse square of the distance."""
    depth, normal = layers["clean"], layers["normal"]
    x, y = layers["rays"][..., 0], layers["rays"][..., 1]
    squared = x * x + y * y + np.float32(1.0)
    length = np.sqrt(squared)
    towards = normal[..., 0] * (x / length) + normal[..., 1] * (y / length)
    cosine = -(towards + normal[..., 2] * (np.float32(1.0) / length))
    distance_squared = squared * depth * depth
    light = p["gain_counts"] * layers["albedo"] * np.maximum(cosine, np.float32(0.0))
    light = light / np.where(depth > 0, distance_squared, np.float32(1.0))
    lit = np.where(depth > 0, light * layers["lit"], np.float32(0.0))
    return {"infrared": p["ambient_counts"] + lit}


def low_signal(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels that return too little infrared light."""
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 0)
    limit = p["min_counts"] + p["spread_counts"] * normal_pair(first, second)[0]
    return _without(layers, layers["infrared"] < limit, Reason.LOW_SIGNAL)


def shadow(_view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels that the emitters do not light."""
    return _without(layers, layers["lit"] < p["min_lit"], Reason.SHADOW)


def range_gate(_view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes depth outside the measuring range."""
    depth_mm = np.float32(1000.0) * layers["depth"]
    outside = (depth_mm < p["near_mm"]) | (depth_mm > p["far_mm"])
    return _without(layers, outside, Reason.OUT_OF_RANGE)


def _without(layers: Layers, lost: NDArray[np.bool_], reason: Reason) -> dict[str, Image]:
    """Depth and reason after the pixels ``lost`` lose their depth."""
    depth = layers["depth"]
    lost = lost & (depth > 0)
    return {
        "depth": np.where(lost, np.float32(0.0), depth),
        "reason": np.where(lost, np.float32(reason), layers["reason"]),
    }
