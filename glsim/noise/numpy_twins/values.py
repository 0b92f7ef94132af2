"""Twins of the stages that add noise to the depth or round it.

Noise: axial, gaussian, fixed_pattern, perlin, simplex. Rounding: disparity_quantise and
millimetre_quantise.
"""

from __future__ import annotations

import numpy as np

from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins import fields
from glsim.noise.numpy_twins.depth import disparity_px, displaced, moved_by_mm
from glsim.noise.numpy_twins.layers import Image, Parameters, pixels
from glsim.noise.numpy_twins.random import (
    correlated_noise,
    normal_pair,
    pcg_word,
    random_bits,
    uniform01,
)

#: pi/2 - a is at least _FROM_POLE, rad: the angle term has a pole at 90 degrees.
_HALF_PI, _FROM_POLE = np.float32(1.57079632679), np.float32(1e-3)

#: Steps of the slow error of fixed_pattern down the image.
_PROFILE_STEPS = np.float32(6.0)


def angle_to_axis(normal: Image) -> Image:
    """Angle between surface normal and optical axis, rad."""
    return np.arccos(np.clip(-normal[..., 2], np.float32(0.0), np.float32(1.0)))


def angle_ratio(angle: Image) -> Image:
    """The ratio a / (pi/2 - a); axial and lateral noise grow with it."""
    ratio: Image = angle / np.maximum(_HALF_PI - angle, _FROM_POLE)
    return ratio


def axial(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds white noise along the axis; sigma grows with distance and angle."""
    z = layers["depth"]
    angle = angle_to_axis(layers["normal"])
    beyond = z - p["quadratic_from_m"]
    sigma = p["base_sigma_mm"] + p["linear_mm_per_m"] * z
    sigma = sigma + p["quadratic_mm_per_m2"] * beyond * beyond
    tilted = (z > 0) & (np.degrees(angle) >= p["angle_from_deg"])
    ratio = angle_ratio(np.where(tilted, angle, np.float32(0.0)))
    power = np.power(np.where(tilted, z, np.float32(1.0)), p["angle_power"])
    sigma = sigma + p["angle_mm"] * power * ratio * ratio
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 0)
    noise = normal_pair(first, second)[0]
    return {"depth": moved_by_mm(z, np.clip(sigma, np.float32(0.0), p["max_sigma_mm"]) * noise)}


def gaussian(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds white noise in depth or in disparity."""
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 0)
    mm, px = normal_pair(first, second)
    return {"depth": _displaced(view, layers, p["sigma_mm"] * mm, p["sigma_px"] * px)}


def fixed_pattern(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds an error per pixel that is the same in every frame of a device."""
    x, y = pixels(view.window)
    own = correlated_noise(view.window, view.device_seed)
    first, second, _, _ = random_bits(x, 0, view.device_seed, 1)
    column = normal_pair(first, second)[0]
    first, second, _, _ = random_bits(0, y, view.device_seed, 2)
    row = normal_pair(first, second)[0]
    half_sign = np.where(2 * y < view.height, np.float32(-1.0), np.float32(1.0))
    place = _PROFILE_STEPS * (y.astype(np.float32) + np.float32(0.5)) / np.float32(view.height)
    step = np.floor(place)
    ends = [
        normal_pair(*random_bits(1, step.astype(np.int64) + k, view.device_seed, 3)[:2])[0]
        for k in (0, 1)
    ]
    share = uniform01(pcg_word(np.array([view.device_seed], np.uint32)))
    profile = p["row_profile_mm"] * share * (ends[0] + (ends[1] - ends[0]) * (place - step))
    odd = np.where(y % 2 == 1, np.float32(1.0), np.float32(-1.0))
    alternation = p["row_alternation_mm"] * half_sign + profile
    alternation = alternation + np.float32(0.5) * p["row_step_mm"]
    error = p["pixel_sigma_mm"] * own + p["column_sigma_mm"] * column
    error = error + p["row_sigma_mm"] * row + odd * alternation
    if "pattern_map" in layers:  # of the whole frame, as on the GPU
        measured = layers["pattern_map"][view.window.slices]
        error = np.where(measured < np.float32(1e5), measured, error)
    return {"depth": moved_by_mm(layers["depth"], error)}


def perlin(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds Perlin noise: a sum of octaves."""
    seed = fields.field_seed(view, p["drift_hz"])
    at = fields.field_position(view, p["lattice_x_px"], p["lattice_y_px"], p["drift_hz"])
    if p["drift_hz"] <= 0:  # a static field lies on a plane of nodes
        at = (at[0], at[1], np.float32(0.0) * at[2])
    lacunarity, persistence = p["lacunarity"], p["persistence"]
    total, weight = np.zeros(1, np.float32), np.float32(1.0)
    for octave in range(int(p["octaves"])):
        total = total + weight * fields.perlin(at, seed + octave)
        at = (at[0] * lacunarity, at[1] * lacunarity, at[2] * lacunarity)
        weight = weight * persistence
    return _with_field(view, layers, p, total)


def simplex(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds simplex noise."""
    at = fields.field_position(view, p["lattice_px"], p["lattice_px"], p["drift_hz"])
    field = fields.simplex(at, fields.field_seed(view, p["drift_hz"]))
    return _with_field(view, layers, p, field)


def disparity_quantise(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Rounds the disparity to multiples of a step."""
    depth, step = layers["depth"], p["step_px"]
    steps = np.floor(disparity_px(depth, view.focal_baseline_px_m) / step + np.float32(0.5))
    rounded = disparity_px(np.maximum(steps, np.float32(1.0)) * step, view.focal_baseline_px_m)
    return {"depth": np.where(depth > 0, rounded, depth)}


def millimetre_quantise(_view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Rounds the depth to multiples of a step."""
    depth, step = layers["depth"], p["step_mm"]
    steps = np.maximum(
        np.floor(np.float32(1000.0) * depth / step + np.float32(0.5)), np.float32(1.0)
    )
    return {"depth": np.where(depth > 0, np.float32(0.001) * step * steps, depth)}


def _with_field(view: StageView, layers: Layers, p: Parameters, field: Image) -> dict[str, Image]:
    by_mm, by_px = p["amplitude_mm"] * field, p["amplitude_px"] * field
    return {"depth": _displaced(view, layers, by_mm, by_px)}


def _displaced(view: StageView, layers: Layers, by_mm: Image, by_px: Image) -> Image:
    return displaced(layers["depth"], by_mm, by_px, view.focal_baseline_px_m)
