"""Twin of tof_fast, the time-of-flight sensor in one step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.depth import moved_by_mm
from glsim.noise.numpy_twins.layers import Image, Parameters, pixels
from glsim.noise.numpy_twins.random import (
    KERNEL,
    KERNEL_UNIT,
    correlated_noise,
    normal_pair,
    random_bits,
)
from glsim.noise.numpy_twins.tof_decode import LOG2_E, decoded, floor_variance
from glsim.noise.numpy_twins.tof_light import expected_depth, phasors
from glsim.noise.numpy_twins.tof_taps import CONTRAST_MULTIPLIER
from glsim.noise.numpy_twins.tof_turns import TWO_PI, frequencies, half_wave_m_mhz

_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_BLUR = {0: np.float32(0.8), 1: np.float32(0.1)}


def tof_fast(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Draws noise from statistics on even surfaces, sums up phasors beside depth steps."""
    clean, lit = layers["clean"], layers["lit"]
    depths = [part[..., 0] for _, _, part in _around(view, clean[..., None])]
    beside = np.max(depths, axis=0) - np.min(depths, axis=0) > np.float32(0.001) * p["step_mm"]
    seen = phasors(view, p, clean, layers["normal"], layers["rays"], lit)
    mixed = sum(
        (_BLUR[abs(dx)] * _BLUR[abs(dy)] * part for dx, dy, part in _around(view, seen)),
        np.zeros_like(seen),
    )
    mixed = np.where(beside[..., None], mixed, seen)
    amplitude = mixed[..., 6]
    real, imaginary, marked = _filtered(view, p, mixed, seen)
    m = CONTRAST_MULTIPLIER
    light = amplitude[..., None] / m
    variance = p["read_variance"] + p["shot_variance"] * light
    sigma = np.sqrt(np.float32(2 / 3) * m * m * variance) / KERNEL_UNIT
    bits = [random_bits(*pixels(view.window), view.seed, 1 + k) for k in range(3)]
    noise = [normal_pair(first, second) for first, second, _, _ in bits]
    real += sigma * np.stack([pair[0] for pair in noise], axis=-1)
    imaginary += sigma * np.stack([pair[1] for pair in noise], axis=-1)
    dimmed = amplitude + sigma.max(axis=-1) * noise[0][0]
    kept = np.where(dimmed < np.float32(1.1) * p["min_amplitude"], _ZERO, _ONE)[..., None]
    real = np.where(beside[..., None], real, kept * mixed[..., 0:6:2])
    imaginary = np.where(beside[..., None], imaginary, kept * mixed[..., 1:6:2])
    z, reason, sums = decoded(view, layers, p, real, imaginary)
    reason = np.where((amplitude <= 0) & (clean <= 0), np.float32(Reason.NO_SURFACE), reason)
    reason = np.where(amplitude > p["saturation_lsb"], np.float32(Reason.SATURATED), reason)
    valid = (reason == Reason.VALID) | (reason == Reason.GROWN)
    turns = np.sqrt((sigma * sigma).sum(axis=-1)) / np.maximum(amplitude, _ONE) / TWO_PI
    light_mm = np.float32(1000.0) * turns * half_wave_m_mhz() / frequencies(view).sum()
    rays = layers["rays"]
    light_mm = light_mm / np.sqrt((rays * rays).sum(axis=-1) + _ONE)  # along z, not along the ray
    light_mm = np.where(beside, _ZERO, light_mm)
    spread = np.sqrt(floor_variance(view, layers, p, z) + light_mm * light_mm)
    z = np.where(valid, z, _ZERO)
    depth = moved_by_mm(
        z, np.where(valid, spread, _ZERO) * correlated_noise(view.window, view.seed)
    )
    usable = np.where(beside & marked, _ZERO, depth)
    return {
        "depth": depth,
        "reason": reason,
        "infrared": np.minimum(np.float32(16.0) * amplitude, np.float32(65535.0)),
        "decoded": np.stack([usable, sums], axis=-1),
        **expected_depth(view, p, layers),
    }


def _filtered(
    view: StageView, p: Parameters, mixed: Image, seen: Image
) -> tuple[Image, Image, NDArray[np.bool_]]:
    """The bilateral filter, neighbours seeing one surface each: real, imaginary, marked."""
    real, imaginary = mixed[..., 0:6:2], mixed[..., 1:6:2]
    unit = _ONE / np.sqrt(np.maximum(real * real + imaginary * imaginary, np.float32(1e-20)))
    bright = mixed[..., 6:] >= p["min_amplitude"]
    total, apart = np.full_like(real, KERNEL[0]), np.zeros_like(real)
    sum_real, sum_imaginary = KERNEL[0] * real, KERNEL[0] * imaginary
    for dx, dy, part in _around(view, seen):
        if dx == 0 and dy == 0:
            continue
        light = part[..., 6:]
        pure = part[..., :6] / np.where(light > 0, light, _ONE)
        r, i = pure[..., 0::2], pure[..., 1::2]
        away = _HALF - _HALF * (real * r + imaginary * i) * unit
        counts = np.where((light >= p["min_amplitude"]) | ~bright, _ONE, _ZERO)
        falls = np.where(bright, np.exp(-LOG2_E * p["sharpness"] * away), _ONE)
        weight = counts * KERNEL[abs(dx) + abs(dy)] * falls
        apart += counts * away
        sum_real += weight * light * r
        sum_imaginary += weight * light * i
        total += weight
    return sum_real / total, sum_imaginary / total, apart.max(axis=-1) >= p["max_edge"]


def _around(view: StageView, image: Image) -> Iterator[tuple[int, int, Image]]:
    """The 3x3 neighbour images of (h, w, n): 0 outside the window, clamped at the frame."""
    left, top, width, height = view.window
    for dy in (-1, 0, 1):
        y = np.clip(np.arange(top, top + height) + dy, 0, view.height - 1) - top
        for dx in (-1, 0, 1):
            x = np.clip(np.arange(left, left + width) + dx, 0, view.width - 1) - left
            part = image[np.clip(y, 0, height - 1)][:, np.clip(x, 0, width - 1)]
            part[(y < 0) | (y >= height)] = 0.0
            part[:, (x < 0) | (x >= width)] = 0.0
            yield dx, dy, part
