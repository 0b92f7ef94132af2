"""Twins of tof_smooth and field_stop, stages of the Azure Kinect."""

from __future__ import annotations

import numpy as np

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.layers import Image, Parameters

_REACH_PX = 3
_TINY = np.float32(1e-20)
_HALF, _ONE = np.float32(0.5), np.float32(1.0)
_HALF_ROOT_3 = np.float32(0.86602540378)


def tof_smooth(_view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Averages phasors over 7x7; neighbours with another phase count less."""
    a, b = layers["phasor_a"], layers["phasor_b"]
    real = np.stack([a[..., 0], a[..., 2], b[..., 0]], axis=-1)
    imaginary = np.stack([a[..., 1], a[..., 3], b[..., 1]], axis=-1)
    norm = real * real + imaginary * imaginary
    unit = _ONE / np.sqrt(np.maximum(norm, _TINY))
    bright = (norm >= p["min_amplitude"] * p["min_amplitude"]).astype(np.float32)
    least = bright * p["min_amplitude"] * p["min_amplitude"]
    falloff = -_HALF / (p["width_px"] * p["width_px"])
    sums = np.zeros((2, *real.shape), np.float32)
    total, apart, near = (np.zeros_like(real) for _ in range(3))
    near += np.float32(1e-6)
    height, width = real.shape[:2]
    border = ((_REACH_PX, _REACH_PX), (_REACH_PX, _REACH_PX), (0, 0))
    around = np.pad(np.concatenate([real, imaginary], axis=-1), border, mode="edge")
    span = range(2 * _REACH_PX + 1)
    for row, column in ((row, column) for row in span for column in span):
        other_real, other_imaginary = np.split(
            around[row : row + height, column : column + width], 2, axis=-1
        )
        squared = np.float32((row - _REACH_PX) ** 2 + (column - _REACH_PX) ** 2)
        other = other_real * other_real + other_imaginary * other_imaginary
        alike = (real * other_real + imaginary * other_imaginary) * unit
        away = _HALF - _HALF * (alike / np.sqrt(np.maximum(other, _TINY)))
        counts = (other >= least).astype(np.float32)
        weight = counts * np.exp(falloff * squared - p["sharpness"] * bright * away)
        sums += weight * np.stack([other_real, other_imaginary])
        total += weight
        apart += counts * away
        near += counts
    kept = (~(b[..., 2:3] > 0)) | (total <= 0).any(axis=-1, keepdims=True)
    edge = ((apart / near).max(axis=-1) >= p["max_apart"]) & ~kept[..., 0]
    mean = sums / np.where(total > 0, total, _ONE)
    both = np.where(kept[..., None], np.stack([real, imaginary], axis=-1), np.moveaxis(mean, 0, -1))
    both = both.reshape(*edge.shape, 6)
    flags = b[..., 3] + edge.astype(np.float32)
    filtered = np.concatenate([both[..., 4:], b[..., 2:3], flags[..., None]], axis=-1)
    return {"phasor_a": both[..., :4], "phasor_b": filtered}


def field_stop(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes depth and infrared outside the lens's field of view."""
    x, y = layers["rays"][..., 0], layers["rays"][..., 1]
    r2 = x * x + y * y
    lens = view.optics.lens
    upper, lower = (
        _ONE + r2 * (np.float32(a) + r2 * (np.float32(b) + r2 * np.float32(c)))
        for a, b, c in ((lens.k1, lens.k2, lens.k3), (lens.k4, lens.k5, lens.k6))
    )
    across = np.abs(x * (upper / lower) - p["centre_x"])
    down = np.abs(y * (upper / lower) - p["centre_y"])
    out_by = np.maximum(down, _HALF_ROOT_3 * across + _HALF * down)
    lost = ((p["side"] > 0) & (out_by > p["side"])) | (r2 >= p["widest_tan"] * p["widest_tan"])
    known = layers["reason"] == Reason.NO_SURFACE
    why = np.where(known, layers["reason"], np.float32(Reason.LOW_SIGNAL))
    zero = np.float32(0.0)
    return {
        "depth": np.where(lost, zero, layers["depth"]),
        "reason": np.where(lost, why, layers["reason"]),
        "infrared": np.where(lost, zero, layers["infrared"]),
    }
