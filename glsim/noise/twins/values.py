"""Twins of the stages that read no neighbours, and of perlin, simplex and field.glsl."""

from __future__ import annotations

from typing import Any

from glsim.core.arrays import Words, of
from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import (
    Image,
    Layers,
    Parameters,
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

#: The angle term a / (pi/2 - a) has a pole at 90 degrees: its denominator is at least 1e-3 rad.
_HALF_PI, _FROM_POLE = 1.57079632679, 1e-3

#: Number of random values of the row profile from top to bottom, interpolated between them.
_PROFILE_STEPS = 6.0

#: Coordinates x, y and z, which broadcast.
Vector = tuple[Image, Image, Image]


def angle_to_axis(normal: Image) -> Image:
    """Compute the angle between surface normal and optical axis, rad."""
    xp = of(normal)
    return xp.arccos(xp.clip(-normal[..., 2], 0.0, 1.0))


def angle_ratio(angle: Image) -> Image:
    """Compute a / (pi/2 - a) of an angle; axial and lateral noise grow with this ratio."""
    return angle / of(angle).maximum(_HALF_PI - angle, _FROM_POLE)


def axial(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds white noise along the axis; sigma grows with distance and angle."""
    z = layers["depth"]
    xp = of(z)
    angle = angle_to_axis(layers["normal"])
    beyond = z - p["quadratic_from_m"]
    sigma = p["base_sigma_mm"] + p["linear_mm_per_m"] * z
    sigma = sigma + p["quadratic_mm_per_m2"] * beyond * beyond
    degrees = xp.rad2deg(angle)
    tilted = (z > 0) & (degrees >= p["angle_from_deg"])
    ratio = angle_ratio(xp.where(tilted, angle, 0.0))
    power = xp.where(tilted, z, 1.0) ** p["angle_power"]
    sigma = sigma + p["angle_mm"] * power * ratio * ratio
    first, second, _, _ = random_bits(*pixels(view.window, view.seed), view.seed, 0)
    noise = normal_pair(first, second)[0]
    return {"depth": moved_by_mm(z, xp.clip(sigma, 0.0, p["max_sigma_mm"]) * noise)}


def gaussian(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds white noise in depth or in disparity."""
    first, second, _, _ = random_bits(*pixels(view.window, view.seed), view.seed, 0)
    mm, px = normal_pair(first, second)
    return displaced(view, layers, p["sigma_mm"] * mm, p["sigma_px"] * px)


def fixed_pattern(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds an error per pixel that is the same in every frame of a device."""
    seed = view.device_seed
    xp, (x, y) = of(seed), pixels(view.window, seed)
    own = correlated_noise(view, seed)
    column = normal_pair(*random_bits(x, 0, seed, 1)[:2])[0]
    row = normal_pair(*random_bits(0, y, seed, 2)[:2])[0]
    half_sign = xp.where(2 * y < view.height, -1.0, 1.0)
    place = _PROFILE_STEPS * (xp.floats(y) + 0.5) / view.height
    step = xp.floor(place)
    above, below = (
        normal_pair(*random_bits(1, xp.words(step) + xp.word(k), seed, 3)[:2])[0] for k in (0, 1)
    )
    profile = p["row_profile_mm"] * (above + (below - above) * (place - step))
    odd = xp.where(y % 2 == 1, 1.0, -1.0)
    alternation = p["row_alternation_mm"] * half_sign + profile
    alternation = alternation + 0.5 * p["row_step_mm"]
    error = p["pixel_sigma_mm"] * own + p["column_sigma_mm"] * column
    error = error + p["row_sigma_mm"] * row + odd * alternation
    if "pattern_map" in layers:  # the map covers the whole frame, as on the GPU
        measured = layers["pattern_map"][view.window.slices]
        error = xp.where(measured < 1e5, measured, error)
    return {"depth": moved_by_mm(layers["depth"], error)}


def perlin(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds Perlin noise: a sum of octaves."""
    seed = field_seed(view, p["drift_hz"])
    at = field_position(view, p["lattice_x_px"], p["lattice_y_px"], p["drift_hz"])
    if p["drift_hz"] <= 0:  # without drift the noise is a plane z = 0 of the lattice
        at = (at[0], at[1], 0.0 * at[2])
    lacunarity, persistence = p["lacunarity"], p["persistence"]
    total: Any = 0.0
    weight = 1.0
    for octave in range(int(p["octaves"])):
        total = total + weight * perlin_at(at, seed + octave)
        at = (at[0] * lacunarity, at[1] * lacunarity, at[2] * lacunarity)
        weight = weight * persistence
    return displaced(view, layers, p["amplitude_mm"] * total, p["amplitude_px"] * total)


def simplex(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds simplex noise."""
    at = field_position(view, p["lattice_px"], p["lattice_px"], p["drift_hz"])
    field = simplex_at(at, field_seed(view, p["drift_hz"]))
    return displaced(view, layers, p["amplitude_mm"] * field, p["amplitude_px"] * field)


def disparity_quantise(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Rounds the disparity to multiples of a step."""
    depth, step = layers["depth"], p["step_px"]
    xp = of(depth)
    steps = xp.floor(disparity_px(depth, view.focal_baseline_px_m) / step + 0.5)
    rounded = disparity_px(xp.maximum(steps, 1.0) * step, view.focal_baseline_px_m)
    return {"depth": xp.where(depth > 0, rounded, depth)}


def millimetre_quantise(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Rounds the depth to multiples of a step."""
    depth, step = layers["depth"], p["step_mm"]
    xp = of(depth)
    steps = xp.maximum(xp.floor(1000.0 * depth / step + 0.5), 1.0)
    return {"depth": xp.where(depth > 0, 0.001 * step * steps, depth)}


def infrared(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Computes infrared light, by Lambert's law and the inverse square of the distance."""
    depth, normal = layers["clean"], layers["normal"]
    xp = of(depth)
    x, y = layers["rays"][..., 0], layers["rays"][..., 1]
    squared = x * x + y * y + 1.0
    length = xp.sqrt(squared)
    towards = normal[..., 0] * (x / length) + normal[..., 1] * (y / length)
    cosine = -(towards + normal[..., 2] * (1.0 / length))
    distance_squared = squared * depth * depth
    light = p["gain_counts"] * layers["albedo"] * xp.maximum(cosine, 0.0)
    light = light / xp.where(depth > 0, distance_squared, 1.0)
    return {"infrared": p["ambient_counts"] + xp.where(depth > 0, light * layers["lit"], 0.0)}


def low_signal(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels that return too little infrared light."""
    first, second, _, _ = random_bits(*pixels(view.window, view.seed), view.seed, 0)
    limit = p["min_counts"] + p["spread_counts"] * normal_pair(first, second)[0]
    return without(layers, layers["infrared"] < limit, Reason.LOW_SIGNAL)


def shadow(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels that the emitters do not light."""
    return without(layers, layers["lit"] < p["min_lit"], Reason.SHADOW)


def range_gate(_view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes depth outside the measuring range."""
    depth_mm = 1000.0 * layers["depth"]
    outside = (depth_mm < p["near_mm"]) | (depth_mm > p["far_mm"])
    return without(layers, outside, Reason.OUT_OF_RANGE)


def _hash(node: tuple[Words, Words, Words], seed: Words) -> Words:
    """Hash a lattice node and a seed to a 32-bit word."""
    x, y, z = node
    return pcg_word(pcg_word(pcg_word(seed ^ pcg_word(z)) + y) + x)


def _gradient(bits: Words, offset: Vector) -> Image:
    """Compute the dot product of an offset with a random gradient: one of a cube's 12 edges."""
    xp = of(bits)
    h = xp.shifted(bits, 28)
    x, y, z = offset
    a = xp.where(h < 8, x, y)
    b = xp.where(h < 4, y, xp.where((h == 12) | (h == 14), x, z))
    return xp.where((h & 1) > 0, -a, a) + xp.where((h & 2) > 0, -b, b)


def perlin_at(at: Vector, seed: Any) -> Image:
    """Compute Perlin noise on a cubic lattice, about -1 to 1, at float32 positions in cells."""
    xp = of(at[0])
    whole = [xp.floor(part) for part in at]
    f = [part - start for part, start in zip(at, whole, strict=True)]
    n, key = [xp.words(part) for part in whole], xp.words(seed, at[0])
    tx, ty, tz = (t * t * t * (t * (t * 6.0 - 15.0) + 10.0) for t in f)  # Perlin's quintic weights
    rows = []
    for y, z in ((0, 0), (1, 0), (0, 1), (1, 1)):
        left, right = (
            _gradient(
                _hash((n[0] + xp.word(x), n[1] + xp.word(y), n[2] + xp.word(z)), key),
                (f[0] - x, f[1] - y, f[2] - z),
            )
            for x in (0, 1)
        )
        rows.append(mix(left, right, tx))
    return mix(mix(rows[0], rows[1], ty), mix(rows[2], rows[3], ty), tz)


def _total(vector: Vector, factor: float) -> Image:
    total: Image = vector[0] * factor + vector[1] * factor + vector[2] * factor
    return total


def simplex_at(at: Vector, seed: Any) -> Image:
    """Compute simplex noise on tetrahedra, about -1 to 1, at float32 positions in cells."""
    xp = of(at[0])
    skew = _total(at, 1 / 3)
    cell = [xp.floor(part + skew) for part in at]
    unskew = _total((cell[0], cell[1], cell[2]), 1 / 6)
    x0, y0, z0 = (part - low + unskew for part, low in zip(at, cell, strict=True))
    xy, yz, xz = (xp.floats(ge) for ge in (x0 >= y0, y0 >= z0, x0 >= z0))
    ranks = xy + xz, 1 - xy + yz, 2 - yz - xz
    n, key = [xp.words(part) for part in cell], xp.words(seed, at[0])
    total: Any = 0.0
    # The corners: the cell's origin, then steps along the largest, second, third coordinate.
    for least, back in ((3, 0.0), (2, 1 / 6), (1, 1 / 3), (0, 0.5)):
        step = [xp.floats(rank >= least) for rank in ranks]
        x, y, z = (part - one + back for part, one in zip((x0, y0, z0), step, strict=True))
        t = xp.maximum(0.5 - (x * x + y * y + z * z), 0.0)
        bits = _hash(
            (n[0] + xp.words(step[0]), n[1] + xp.words(step[1]), n[2] + xp.words(step[2])), key
        )
        total = total + t * t * t * t * _gradient(bits, (x, y, z))
    noise: Image = 76.0 * total
    return noise


def field_seed(view: FrameContext, drift_hz: float) -> Any:
    """Return the seed of a noise field: the frame's seed, or with drift the sequence's."""
    return view.sequence_seed if drift_hz > 0 else view.seed


def field_position(
    view: FrameContext, lattice_x_px: float, lattice_y_px: float, drift_hz: float
) -> Vector:
    """Return each pixel's position, in lattice cells, in a noise field that drifts along z."""
    seed = field_seed(view, drift_hz)
    xp, (x, y) = of(seed), pixels(view.window, seed)
    start = [3.0 * uniform01(word) for word in random_bits(0, 0, seed, 0xF1E1D)[:3]]
    return (
        start[0] + (xp.floats(x) + 0.5) / lattice_x_px,
        start[1] + (xp.floats(y) + 0.5) / lattice_y_px,
        start[2] + view.time_s * drift_hz,
    )
