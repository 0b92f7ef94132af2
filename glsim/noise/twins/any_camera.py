"""Twins of any_camera_edges, _noise and _losses, and of shaders/lib/lattice_noise.glsl."""

from __future__ import annotations

import math
from typing import Any

from glsim.core.array_types import Mask
from glsim.core.arrays import Numbers, Words, of
from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import (
    Image,
    Layers,
    Neighbours,
    Parameters,
    around,
    fetch,
    has_depth,
    mix,
    moved_by_mm,
    normal_pair,
    pcg_word,
    pixels,
    random_bits,
    select,
    square,
    uniform01,
    value_range,
    where_worthwhile,
    without,
)

_TWO_PI, _FAR, _MOST_HAZE_M = 6.28318530718, 1e4, 0.04
_SKIN_ALBEDO, _USUAL_M, _DARKEST = 0.6, 0.9, 0.04


def any_camera_edges(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Simulates silhouettes, shadows and infrared light of an unknown depth camera."""
    x, y = pixels(view.window, view.seed)
    clean = layers["clean"]
    xp, zero = of(clean), of(clean).zeros_like(clean)
    bumps = lattice_noise(view, (p["rough_length_px"],) * 2, view.seed)
    growth = p["growth_px"] + p["rough_px"] * bumps + (normal_share(bumps) - 0.5)
    chance = [uniform01(word) for word in random_bits(x, y, view.seed, 1)]
    bright = skin_signal(clean, layers["albedo"], 1.0, 1.0)  # as if facing the camera
    step = 0.001 * p["step_mm_per_m"] * clean
    at, own_p = where_worthwhile(view, value_range(view, clean, 2) > step, p)
    depths, lights = (around(view, part, 2, clamped=True, at=at) for part in (clean, bright))
    own_growth, own_chance = (n if at is None else n[at] for n in (growth, chance[0]))
    found: list[Any] = _beside_steps(depths, lights, own_growth, own_chance, own_p)
    if at is not None:
        even: list[Any] = [clean, clean, zero, bright, zero > 0, zero > 0]
        found = [part.index_put(at, values) for part, values in zip(even, found, strict=True)]
    own, z, mixed, light, grows, lost = found
    z = xp.where(mixed > 0, xp.maximum(z, 0.05), own)
    z, least = _hazed(view, clean, bright, z, own, light, p)

    shadowed = ~grows & (clean > 0) & (layers["lit"] < p["shadow_lit"])
    between = shadowed & (chance[2] < p["shadow_between"])
    z = xp.where(between, mix(z, least, chance[3]), z)

    other = xp.abs(z - clean) > xp.maximum(0.001 * p["step_mm_per_m"] * own, step)
    hidden = shadowed & ~(chance[1] < p["shadow_kept"])
    reason = select(
        [
            ((own <= 0) & (clean > 0), float(Reason.EDGE)),
            (own <= 0, float(Reason.NO_SURFACE)),
            (hidden, float(Reason.SHADOW)),
            (lost, float(Reason.EDGE)),
            (mixed > p["max_mixed"], float(Reason.MIXED)),
            (clean <= 0, float(Reason.GROWN)),
            (other, float(Reason.MOVED)),
        ],
        zero + float(Reason.VALID),
    )
    return {
        "depth": xp.where(has_depth(reason), z, 0.0),
        "reason": reason,
        "infrared": _infrared(view, layers, p, light),
    }


def _beside_steps(
    depths: Neighbours, lights: Neighbours, growth: Image, chance: Image, p: Parameters
) -> list[Image | Mask]:
    """Find the surface that a pixel near a depth step sees, and mix depths by the point spread.

    Args:
        depths, lights: functions (dx, dy) -> clean depth, m, and brightness at that offset.
        growth: width, px, by which near surfaces grow; negative if they shrink.
        chance: uniform random numbers, 0 to 1.

    Returns:
        Depth of the surface, m; mixed depth, m; share of other surfaces; collected light; mask of
        pixels over which a nearer surface has grown; mask of lost pixels.
    """
    clean = depths(0, 0)
    xp, zero = of(clean), of(clean).zeros_like(clean)
    step = 0.001 * p["step_mm_per_m"] * clean
    to_front = to_behind = front = zero + _FAR
    behind = zero
    for dx, dy in square(2):
        away = math.sqrt(dx * dx + dy * dy) - 0.5
        there = depths(dx, dy)
        nearer = (there > 0) & ((clean <= 0) | (there < clean - step))
        farther = (clean > 0) & ((there <= 0) | (there > clean + step))
        front = xp.where(nearer & (away <= growth), xp.minimum(front, there), front)
        to_front = xp.where(nearer, xp.minimum(to_front, away), to_front)
        behind = xp.where(farther & (away < to_behind), there, behind)
        to_behind = xp.where(farther, xp.minimum(to_behind, away), to_behind)
    grows = front < _FAR
    shrinks = ~grows & (to_behind <= -growth)
    band = xp.maximum(growth, 0.0) + p["cut_px"]
    cut = ~grows & (clean > 0) & (p["cut_px"] > 0) & (to_front <= band)
    lost = shrinks & ((behind <= 0) | (chance < p["edge_holes"]))
    own = xp.where(grows, front, xp.where(shrinks, behind, clean))

    own_step = 0.001 * p["step_mm_per_m"] * own
    mixes = (xp.minimum(to_front, to_behind) < _FAR) & (p["psf_px"] > 0)
    total = alike = light = cosines = sines = zero
    area: Any = 0.0
    falls = -0.5 / xp.maximum(p["psf_px"] * p["psf_px"], 1e-6)
    for dx, dy in square(2):
        there, lit = depths(dx, dy), lights(dx, dy)
        share = xp.exp(falls * float(dx * dx + dy * dy))
        weight = xp.where(there > 0, share * (1.0 + p["light_mix"] * (lit - 1.0)), 0.0)
        angle = _TWO_PI * (there - own) / p["wavelength_m"]
        cosines = cosines + weight * xp.cos(angle)
        sines = sines + weight * xp.sin(angle)
        total = total + weight
        alike = alike + xp.where(xp.abs(there - own) <= own_step, weight, 0.0)
        area = area + share
        light = light + share * lit
    blended = own + xp.arctan2(sines, cosines) * p["wavelength_m"] / _TWO_PI
    blended = xp.where(mixes, blended, own)
    mixed = xp.where(mixes & (own > 0), 1.0 - alike / xp.maximum(total, 1e-6), 0.0)
    return [own, blended, mixed, xp.where(mixes, light / area, lights(0, 0)), grows, lost | cut]


def _hazed(
    view: FrameContext, clean: Image, bright: Image, z: Image, own: Image, light: Image,
    p: Parameters,
) -> tuple[Image, Image]:  # fmt: skip
    """Pull depth, m, to its surroundings by stray light; also return their smallest depth, m."""
    xp, (x, y) = of(z), pixels(view.window, view.seed)
    around_ = pull = xp.zeros_like(z)
    least = clean
    for n in range(8):
        angle, reach = 0.785398163 * n, 1.0 * p["haze_px"] * (1.0 if n % 2 == 0 else 0.6)
        dx, dy = (xp.floor(reach * way + 0.5) for way in (math.cos(angle), math.sin(angle)))
        column = xp.clip(x + xp.integers(dx), 0, view.width - 1)
        row = xp.clip(y + xp.integers(dy), 0, view.height - 1)
        there, lit = (fetch(layer, view.window, column, row) for layer in (clean, bright))
        around_ = around_ + 0.125 * lit
        pull = pull + 0.125 * lit * (there - z)
        least = xp.where(there > 0, xp.minimum(least, there), least)
    moved = p["haze"] * pull / xp.maximum(light + p["haze"] * around_, 0.001)
    return z + xp.where(own > 0, xp.clip(moved, -_MOST_HAZE_M, _MOST_HAZE_M), 0.0), least


def _infrared(view: FrameContext, layers: Layers, p: Parameters, light: Image) -> Image:
    """Compute infrared counts, 0 to 65535, with read noise and shot noise."""
    xp = of(light)
    cosine, squared, _ = incidence(layers["normal"], layers["rays"])
    lambert = xp.maximum(cosine, 0.0) * layers["lit"]
    counts = p["gain_counts"] * light * xp.where(layers["clean"] > 0, lambert, 1.0) / squared
    first, second, _, _ = random_bits(*pixels(view.window, view.seed), view.seed, 2)
    sigma = xp.sqrt(p["read_counts"] * p["read_counts"] + p["shot_counts"] * counts)
    noisy = xp.floor(counts + sigma * normal_pair(first, second)[0] + 0.5)
    return xp.clip(noisy, 0.0, 65535.0)


def incidence(normal: Image, rays: Image) -> tuple[Image, Image, Mask]:
    """Compute cosine of incidence, squared ray length at z = 1, and mask of pixels with normal."""
    x, y, (a, b, c) = rays[..., 0], rays[..., 1], (normal[..., k] for k in range(3))
    squared = x * x + y * y + 1.0
    facing = -(a * x + b * y + c)
    return facing / of(x).sqrt(squared), squared, a * a + b * b + c * c > 0


def skin_signal(depth: Image, albedo: Image, lambert: Numbers, squared: Numbers) -> Image:
    """Compute the returned light as skin_signal.glsl does; 1 = skin facing the camera at 0.9 m.

    Args:
        depth: metres, 0 = none.
        albedo: reflectivity, relative to a white wall.
        lambert: cosine of the angle of incidence, at least 0.
        squared: squared length of the ray at z = 1.
    """
    xp = of(depth)
    near = _USUAL_M / xp.maximum(depth, 0.001)
    light = albedo / _SKIN_ALBEDO * lambert * near * near / squared
    return xp.where(depth > 0, light, 0.0)


def any_camera_noise(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise and a systematic error of an unknown depth camera."""
    z = layers["depth"]
    xp = of(z)
    cosine, squared, known = incidence(layers["normal"], layers["rays"])
    usual, lambert = xp.zeros_like(z) + _USUAL_M, xp.maximum(cosine, 0.0)
    light = skin_signal(usual, layers["albedo"], lambert, squared)
    light = xp.where(known, xp.maximum(light, _DARKEST), 1.0)
    ratio = xp.maximum(z, 0.001) / _USUAL_M
    by_light = p["light_mm"] * ratio ** p["distance_power"]
    by_light = by_light * light ** -p["light_power"]
    by_inverse = 1000.0 * p["inverse_per_m"] * z * z
    sigma: Image = p["floor_mm"] * p["floor_mm"] + by_light * by_light + by_inverse * by_inverse
    sigma = xp.minimum(xp.sqrt(sigma), p["max_sigma_mm"])
    bits = random_bits(*pixels(view.window, view.seed), view.seed, 0)
    white, scale = normal_pair(bits[0], bits[1])
    spacing, device = (p["length_x_px"], p["length_y_px"]), view.device_seed
    field = xp.sqrt(1.0 - p["static_share"]) * lattice_noise(view, spacing, view.seed)
    field = field + xp.sqrt(p["static_share"]) * lattice_noise(view, spacing, device + 1)
    noise = xp.sqrt(p["white_share"]) * white + xp.sqrt(1.0 - p["white_share"]) * field
    noise = noise * xp.exp(p["tail"] * scale - p["tail"] * p["tail"])
    smooth = lattice_noise(view, (p["smooth_px"],) * 2, view.seed + 1)
    error = sigma * noise + p["smooth_mm"] * smooth
    far_off = uniform01(pcg_word(bits[0])) < p["outlier_share"]
    second = normal_pair(bits[2], bits[3])[0]
    error = error + xp.where(far_off, p["outlier_mm"] * second, 0.0)
    written = {"depth": moved_by_mm(z, error + _systematic_mm(view, p, z))}
    if "expected" in layers:
        right = layers["expected"]
        written["expected"] = moved_by_mm(right, _systematic_mm(view, p, right))
    return written


def _systematic_mm(view: FrameContext, p: Parameters, z: Image) -> Image:
    """Compute the systematic error, mm, at the depths ``z`` (m); a positive error is too far."""
    xp, seed = of(z), view.device_seed
    phase = uniform01(pcg_word(xp.words(seed, seed)))
    x, y = (xp.floats(n) + 0.5 for n in pixels(view.window, seed))
    beside_x = 2.0 * x / view.width - 1.0
    beside_y = 2.0 * y / view.height - 1.0
    turns = z / p["wiggle_period_m"] + phase
    wave = xp.sin(_TWO_PI * (turns - xp.floor(turns)))
    linear = p["offset_mm"] + p["scale_mm_per_m"] * z
    tilted = p["tilt_x_mm"] * beside_x + p["tilt_y_mm"] * beside_y
    return linear + tilted + p["wiggle_mm"] * wave


def any_camera_losses(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels and rounds disparities, as an unknown depth camera does."""
    depth = layers["depth"]
    xp, (cosine, squared, known) = of(depth), incidence(layers["normal"], layers["rays"])
    signal = skin_signal(depth, layers["albedo"], xp.maximum(cosine, 0.0), squared)
    signal, cosine = xp.where(known, signal, 1.0), xp.where(known, cosine, 1.0)
    bits = random_bits(*pixels(view.window, view.seed), view.seed, 0)
    white, second = normal_pair(bits[0], bits[1])
    spacing = (p["cluster_px"],) * 2
    clusters = normal_share(lattice_noise(view, spacing, view.seed))
    more = lattice_noise(view, spacing, view.seed + 1)
    limit = p["dark_signal"] * xp.exp(p["dark_spread"] * 0.70710678 * (white + more))
    grazing = cosine < p["grazing_cosine"] + p["grazing_spread"] * second
    dropped = (clusters < p["cluster_share"]) | (uniform01(bits[2]) < p["single_share"])
    reason = select(
        [
            ((signal < limit) | grazing, float(Reason.LOW_SIGNAL)),
            (signal > p["saturated_signal"], float(Reason.SATURATED)),
            (dropped, float(Reason.DROPPED)),
        ],
        xp.zeros_like(depth) + float(Reason.VALID),
    )
    per_m = 1000.0 * p["step_px"] / p["focal_baseline_px_mm"]
    rounds = (depth > 0) & (per_m > 0)
    safe_per_m = xp.where(rounds, per_m, 1.0)
    steps = xp.maximum(xp.floor(1.0 / (xp.where(rounds, depth, 1.0) * safe_per_m) + 0.5), 1.0)
    depth = xp.where(rounds, 1.0 / (safe_per_m * steps), depth)
    return without({**layers, "depth": depth}, reason != Reason.VALID, reason)


def _node(word: Words) -> Image:
    """Convert a lattice node's random word to a value of variance 1, from the sum of its bytes."""
    xp, byte = of(word), of(word).word(255)
    total = (word & byte) + (xp.shifted(word, 8) & byte) + (xp.shifted(word, 16) & byte)
    return (xp.floats(total + xp.shifted(word, 24)) - 510.0) * 6.76583e-3


def lattice_noise(view: FrameContext, spacing_px: tuple[float, float], seed: Any) -> Image:
    """Return a smooth random (h, w) field of variance 1; its nodes are ``spacing_px`` apart."""
    xp, blends, nodes = of(seed), [], []
    key = pcg_word(xp.words(seed, seed))
    starts, (left, top, width, height) = (uniform01(key), uniform01(pcg_word(key))), view.window
    for first, side, spacing, start in zip(
        (left, top), (width, height), spacing_px, starts, strict=True
    ):
        # Reading a tensor's spacing would stall a GPU: assume a node on every pixel.
        apart = 1.0 if view.batched and not isinstance(spacing, float) else float(spacing)
        node = xp.range(int(first / apart) - 1, int((first + side - 1) / apart) + 4, key)
        at = xp.floats(xp.range(first, first + side, key))[:, None] / spacing + start
        away = xp.abs(at - xp.floats(node))
        outer = xp.maximum(1.5 - away, 0.0)
        blend = xp.where(away < 0.5, 0.75 - away * away, 0.5 * outer * outer)
        blends.append(blend / xp.sqrt((blend * blend).sum(-1))[..., None])
        nodes.append(xp.words(node))
    row = pcg_word(key ^ pcg_word(nodes[1])[:, None])
    return blends[1] @ _node(pcg_word(row + nodes[0])) @ blends[0].mT


def normal_share(n: Image) -> Image:
    """Compute the cumulative normal distribution at ``n``; its error is at most 0.0003."""
    return 0.5 + 0.5 * of(n).tanh(0.7978846 * (n + 0.044715 * n * n * n))
