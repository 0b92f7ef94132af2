"""Twins of the decoder (tof_bilateral, tof_unwrap, tof_edge) and of tof_floor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.depth import moved_by_mm
from glsim.noise.numpy_twins.layers import Image, Parameters, pixels
from glsim.noise.numpy_twins.random import KERNEL, correlated_noise
from glsim.noise.numpy_twins.tof_turns import (
    TWO_PI,
    along_axis,
    distance_of,
    frequencies,
    phases,
    unwrapped_cycles,
)

_STEEPEST = np.float32(12.0)
LOG2_E = np.float32(1.442695)
_LOG10_2, _LOG2_10 = np.float32(0.301030), np.float32(3.321928)
_TINY = np.float32(1e-20)
_HALF = np.float32(0.5)
_ZERO = np.float32(0.0)


def tof_bilateral(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Averages phasors over 3x3; neighbours with another phase count less."""
    a, b = layers["phasor_a"], layers["phasor_b"]
    real = np.stack([a[..., 0], a[..., 2], b[..., 0]], axis=-1)
    imaginary = np.stack([a[..., 1], a[..., 3], b[..., 1]], axis=-1)
    norm = real * real + imaginary * imaginary
    unit = np.float32(1.0) / np.sqrt(np.maximum(norm, _TINY))
    bright = (norm >= p["min_amplitude"] * p["min_amplitude"]).astype(np.float32)
    least = bright * p["min_amplitude"] * p["min_amplitude"]
    falloff = -LOG2_E * p["sharpness"] * bright
    sum_real, sum_imaginary = KERNEL[0] * real, KERNEL[0] * imaginary
    total, apart = np.full_like(real, KERNEL[0]), np.zeros_like(real)
    around = np.concatenate([real, imaginary, norm, unit], axis=-1)
    for steps, other in _neighbours(around):
        other_real, other_imaginary, other_norm, other_unit = np.split(other, 4, axis=-1)
        alike = (real * other_real + imaginary * other_imaginary) * unit * other_unit
        away = _HALF - _HALF * alike
        counts = (other_norm >= least).astype(np.float32)
        weight = counts * KERNEL[steps] * np.exp(falloff * away)
        apart += counts * away
        sum_real += weight * other_real
        sum_imaginary += weight * other_imaginary
        total += weight
    kept = (~(b[..., 2] > 0) | _border(view))[..., None]
    edge = (apart.max(axis=-1) >= p["max_edge"]) & ~kept[..., 0]
    real = np.where(kept, real, sum_real / total)
    imaginary = np.where(kept, imaginary, sum_imaginary / total)
    both = np.stack([real, imaginary], axis=-1).reshape(*edge.shape, 6)
    flags = b[..., 3] + edge.astype(np.float32)
    filtered = np.concatenate([both[..., 4:], b[..., 2:3], flags[..., None]], axis=-1)
    return {"phasor_a": both[..., :4], "phasor_b": filtered}


def tof_unwrap(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Unwraps phases to depth along the axis."""
    a, b = layers["phasor_a"], layers["phasor_b"]
    real = np.stack([a[..., 0], a[..., 2], b[..., 0]], axis=-1)
    imaginary = np.stack([a[..., 1], a[..., 3], b[..., 1]], axis=-1)
    z, reason, sums = decoded(view, layers, p, real, imaginary)
    reason = np.where(b[..., 3] >= 2, np.float32(Reason.SATURATED), reason)
    depth = np.where((reason == Reason.VALID) | (reason == Reason.GROWN), z, _ZERO)
    edge = (b[..., 3] == 1) | (b[..., 3] == 3)
    return {
        "depth": depth,
        "reason": reason,
        "infrared": b[..., 2],
        "decoded": np.stack([np.where(edge, _ZERO, depth), sums], axis=-1),
    }


def decoded(
    view: StageView, layers: Layers, p: Parameters, real: Image, imaginary: Image
) -> tuple[Image, Image, Image]:
    """Depth (m), reason and sum of amplitudes from phasor parts (..., 3)."""
    amplitude = np.sqrt(real * real + imaginary * imaginary)
    f = frequencies(view)
    fast, slow, third = unwrapped_cycles(phases(real, imaginary), f)
    x, y, w = f / np.sqrt((f * f).sum())
    u, v, t = TWO_PI * fast, TWO_PI * slow, TWO_PI * third
    cross = v * w - t * y, t * x - u * w, u * y - v * x
    disagreement = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]
    most = np.maximum(amplitude.max(axis=-1), np.float32(1e-6))
    power = (np.log(most) * p["slope"] * _LOG10_2 + p["offset"]) * _LOG2_10
    allowed = np.clip(np.exp(power), p["min_disagreement"], p["max_disagreement"])
    z = along_axis(view, layers["rays"], distance_of(fast, slow, third, f))
    clean, sums = layers["clean"], amplitude[..., 0] + amplitude[..., 1] + amplitude[..., 2]
    dark = (amplitude.min(axis=-1) < p["min_amplitude"]) | (sums < p["min_sum"])
    why_dark = np.where(layers["lit"] < _HALF, Reason.SHADOW, Reason.LOW_SIGNAL)
    reason = np.select(
        [dark, (disagreement > allowed * allowed) | (z <= 0), clean <= 0],
        [
            np.where(clean <= 0, Reason.NO_SURFACE, why_dark),
            np.where((clean > 0) & (layers["lit"] < _HALF), Reason.SHADOW, Reason.UNWRAP),
            np.full(dark.shape, Reason.GROWN),
        ],
        default=Reason.VALID,
    )
    return z, reason.astype(np.float32), sums


def tof_edge(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels between two surfaces and pixels that the bilateral filter marked."""
    own, z = layers["decoded"], layers["depth"]
    sums = own[..., 1].copy()
    squares, low, high = sums * sums, z.copy(), z.copy()
    for _, other in _neighbours(own):
        sums += other[..., 1]
        squares += other[..., 1] * other[..., 1]
        there = np.where(other[..., 0] > 0, other[..., 0], z)
        low, high = np.minimum(low, there), np.maximum(high, there)
    nine, mm = np.float32(9.0), np.float32(1000.0)
    spread = np.sqrt(np.maximum(nine * squares - sums * sums, _ZERO)) / nine
    contrast = spread / np.maximum(sums / nine, p["min_mean"])
    near, far = mm * (z - low), mm * (high - z)
    between = (contrast >= p["min_contrast"]) & (near > p["nearest_mm"])
    between &= (far > p["farthest_mm"]) & (np.maximum(near, far) > p["larger_mm"])
    inner = (z > 0) & ~_border(view)
    lost = inner & (between | ((own[..., 0] <= 0) & (p["remove_mixed"] > 0)))
    why = np.where(between, np.float32(Reason.EDGE), np.float32(Reason.MIXED))
    return {
        "depth": np.where(lost, _ZERO, z),
        "reason": np.where(lost, why, layers["reason"]),
    }


def tof_floor(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise that does not depend on the light and is correlated between neighbours."""
    depth = layers["depth"]
    sigma = np.sqrt(floor_variance(view, layers, p, depth))
    return {"depth": moved_by_mm(depth, sigma * correlated_noise(view.window, view.seed))}


def floor_variance(view: StageView, layers: Layers, p: Parameters, depth_m: Image) -> Image:
    """Variance of the noise that does not depend on the light, mm^2."""
    normal, rays = layers["normal"], layers["rays"]
    facing = normal[..., 0] * rays[..., 0] + normal[..., 1] * rays[..., 1] + normal[..., 2]
    aside = np.sqrt(normal[..., 0] * normal[..., 0] + normal[..., 1] * normal[..., 1])
    slope = np.minimum(aside / np.maximum(-facing, np.float32(1e-3)), _STEEPEST)
    focal = np.float32(view.optics.focal_px)
    slanted = p["lateral_px"] * slope * np.float32(1000.0) * depth_m / focal
    variance: Image = p["sigma_mm"] * p["sigma_mm"] + slanted * slanted
    return variance


def _border(view: StageView) -> NDArray[np.bool_]:
    """The border pixels of the frame, which the decoder does not filter."""
    x, y = pixels(view.window)
    border: NDArray[np.bool_] = (x == 0) | (x == view.width - 1) | (y == 0) | (y == view.height - 1)
    return border


def _neighbours(image: Image) -> Iterator[tuple[int, Image]]:
    """The 8 neighbour images of (h, w, n), 0 outside, each with |dx| + |dy|, in reading order."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)))
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if dx or dy:
                part = padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
                yield abs(dx) + abs(dy), part
