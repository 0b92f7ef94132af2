"""NumPy twins of the stages that read no neighbours, and of perlin, simplex and field.glsl."""

from __future__ import annotations

import numpy as np

from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.numpy_twins.layers import (
    Image,
    Parameters,
    Words,
    correlated_noise,
    disparity_px,
    displaced,
    mix,
    moved_by_mm,
    normal_pair,
    pcg_word,
    pixels,
    random_bits,
    uniform01,
    without,
)

#: pi/2 - a is at least _FROM_POLE, rad: the angle term has a pole at 90 degrees.
_HALF_PI, _FROM_POLE = np.float32(1.57079632679), np.float32(1e-3)

#: Steps of the slow error of fixed_pattern down the image.
_PROFILE_STEPS = np.float32(6.0)

#: A point or a vector: its three coordinates, which broadcast.
Vector = tuple[Image, Image, Image]


def angle_to_axis(normal: Image) -> Image:
    """Compute the angle between surface normal and optical axis, rad."""
    return np.arccos(np.clip(-normal[..., 2], np.float32(0.0), np.float32(1.0)))


def angle_ratio(angle: Image) -> Image:
    """Compute a / (pi/2 - a) of an angle; axial and lateral noise grow with this ratio."""
    ratio: Image = angle / np.maximum(_HALF_PI - angle, _FROM_POLE)
    return ratio


def axial(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
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


def gaussian(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds white noise in depth or in disparity."""
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 0)
    mm, px = normal_pair(first, second)
    by_mm, by_px = p["sigma_mm"] * mm, p["sigma_px"] * px
    return {"depth": displaced(layers["depth"], by_mm, by_px, view.focal_baseline_px_m)}


def fixed_pattern(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
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


def perlin(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds Perlin noise: a sum of octaves."""
    seed = field_seed(view, p["drift_hz"])
    at = field_position(view, p["lattice_x_px"], p["lattice_y_px"], p["drift_hz"])
    if p["drift_hz"] <= 0:  # a static field lies on a plane of nodes
        at = (at[0], at[1], np.float32(0.0) * at[2])
    lacunarity, persistence = p["lacunarity"], p["persistence"]
    total, weight = np.zeros(1, np.float32), np.float32(1.0)
    for octave in range(int(p["octaves"])):
        total = total + weight * perlin_at(at, seed + octave)
        at = (at[0] * lacunarity, at[1] * lacunarity, at[2] * lacunarity)
        weight = weight * persistence
    return _with_field(view, layers, p, total)


def simplex(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds simplex noise."""
    at = field_position(view, p["lattice_px"], p["lattice_px"], p["drift_hz"])
    field = simplex_at(at, field_seed(view, p["drift_hz"]))
    return _with_field(view, layers, p, field)


def disparity_quantise(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Rounds the disparity to multiples of a step."""
    depth, step = layers["depth"], p["step_px"]
    steps = np.floor(disparity_px(depth, view.focal_baseline_px_m) / step + np.float32(0.5))
    rounded = disparity_px(np.maximum(steps, np.float32(1.0)) * step, view.focal_baseline_px_m)
    return {"depth": np.where(depth > 0, rounded, depth)}


def millimetre_quantise(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Rounds the depth to multiples of a step."""
    depth, step = layers["depth"], p["step_mm"]
    steps = np.maximum(
        np.floor(np.float32(1000.0) * depth / step + np.float32(0.5)), np.float32(1.0)
    )
    return {"depth": np.where(depth > 0, np.float32(0.001) * step * steps, depth)}


def _with_field(
    view: FrameContext, layers: Layers, p: Parameters, field: Image
) -> dict[str, Image]:
    by_mm, by_px = p["amplitude_mm"] * field, p["amplitude_px"] * field
    return {"depth": displaced(layers["depth"], by_mm, by_px, view.focal_baseline_px_m)}


def infrared(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Computes infrared light, by Lambert's law and the inverse square of the distance."""
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


def low_signal(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels that return too little infrared light."""
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 0)
    limit = p["min_counts"] + p["spread_counts"] * normal_pair(first, second)[0]
    return without(layers, layers["infrared"] < limit, Reason.LOW_SIGNAL)


def shadow(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels that the emitters do not light."""
    return without(layers, layers["lit"] < p["min_lit"], Reason.SHADOW)


def range_gate(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes depth outside the measuring range."""
    depth_mm = np.float32(1000.0) * layers["depth"]
    outside = (depth_mm < p["near_mm"]) | (depth_mm > p["far_mm"])
    return without(layers, outside, Reason.OUT_OF_RANGE)


def _hash(node: tuple[Words, Words, Words], seed: int) -> Words:
    """Hash a lattice node and a seed to a 32-bit word; the seed wraps at 2^32."""
    x, y, z = node
    return pcg_word(pcg_word(pcg_word(np.uint32(seed % 2**32) ^ pcg_word(z)) + y) + x)


def _gradient(bits: Words, offset: Vector) -> Image:
    """Compute the dot product of an offset and a random gradient, one of 12 edges of a cube."""
    h = bits >> np.uint32(28)
    x, y, z = offset
    a = np.where(h < 8, x, y)
    b = np.where(h < 4, y, np.where((h == 12) | (h == 14), x, z))
    return np.where(h & 1, -a, a) + np.where(h & 2, -b, b)


def _fade(t: Image) -> Image:
    """Compute Perlin's quintic weight, 0 to 1 over a lattice cell, flat at both ends."""
    slope = t * (t * np.float32(6.0) - np.float32(15.0)) + np.float32(10.0)
    quintic: Image = t * t * t * slope
    return quintic


def _words(whole: Image) -> Words:
    """Convert integers of any sign to 32-bit words, modulo 2^32."""
    return whole.astype(np.int64).astype(np.uint32)


def perlin_at(at: Vector, seed: int) -> Image:
    """Compute Perlin noise on a cubic lattice, about -1 to 1.

    Args:
        at: float32, in lattice cells.
    """
    whole = [np.floor(part) for part in at]
    f = [part - start for part, start in zip(at, whole, strict=True)]
    n = [_words(part) for part in whole]
    tx, ty, tz = (_fade(part) for part in f)
    low, high = np.uint32(0), np.uint32(1)
    rows = []
    for y, z in ((low, low), (high, low), (low, high), (high, high)):
        left, right = (
            _gradient(
                _hash((n[0] + x, n[1] + y, n[2] + z), seed),
                (f[0] - np.float32(x), f[1] - np.float32(y), f[2] - np.float32(z)),
            )
            for x in (low, high)
        )
        rows.append(mix(left, right, tx))
    return mix(mix(rows[0], rows[1], ty), mix(rows[2], rows[3], ty), tz)


def _total(vector: Vector, factor: float) -> Image:
    by = np.float32(factor)
    total: Image = vector[0] * by + vector[1] * by + vector[2] * by
    return total


def simplex_at(at: Vector, seed: int) -> Image:
    """Compute simplex noise on a lattice of tetrahedra, about -1 to 1.

    Args:
        at: float32, in lattice cells.
    """
    skew = _total(at, 1 / 3)
    cell = [np.floor(part + skew) for part in at]
    unskew = _total((cell[0], cell[1], cell[2]), 1 / 6)
    x0, y0, z0 = (part - low + unskew for part, low in zip(at, cell, strict=True))
    xy, yz, xz = (ge.astype(np.int8) for ge in (x0 >= y0, y0 >= z0, x0 >= z0))
    ranks = xy + xz, 1 - xy + yz, 2 - yz - xz
    n = [_words(part) for part in cell]
    total = np.zeros(1, np.float32)
    # The corners follow the coordinates by rank: a step along no axis, one, two, all three.
    for least, back in ((3, 0.0), (2, 1 / 6), (1, 1 / 3), (0, 0.5)):
        step = [rank >= least for rank in ranks]
        x, y, z = (
            part - one.astype(np.float32) + np.float32(back)
            for part, one in zip((x0, y0, z0), step, strict=True)
        )
        t = np.maximum(np.float32(0.5) - (x * x + y * y + z * z), np.float32(0.0))
        bits = _hash((n[0] + step[0], n[1] + step[1], n[2] + step[2]), seed)
        total = total + t * t * t * t * _gradient(bits, (x, y, z))
    return np.float32(76.0) * total


def field_seed(view: FrameContext, drift_hz: np.float32) -> int:
    """Return the seed of a noise field: the frame's without drift, the sequence's with drift."""
    return view.sequence_seed if drift_hz > 0 else view.seed


def field_position(
    view: FrameContext, lattice_x_px: np.float32, lattice_y_px: np.float32, drift_hz: np.float32
) -> Vector:
    """Return the position of each pixel of the window in the noise field, in lattice cells."""
    x, y = pixels(view.window)
    bits = random_bits(0, 0, field_seed(view, drift_hz), 0xF1E1D)
    start = [np.float32(3.0) * uniform01(word) for word in bits[:3]]
    time = np.float32(view.time_s) * drift_hz
    return (
        start[0] + (x.astype(np.float32) + np.float32(0.5)) / lattice_x_px,
        start[1] + (y.astype(np.float32) + np.float32(0.5)) / lattice_y_px,
        start[2] + time,
    )
