"""NumPy twins of any_camera_edges, _noise and _losses, and of shaders/lib/lattice_noise.glsl."""

from __future__ import annotations

import numpy as np

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.numpy_twins.layers import (
    Image,
    Parameters,
    Words,
    beside,
    mix,
    moved_by_mm,
    normal_pair,
    pcg_word,
    pixels,
    random_bits,
    square,
    uniform01,
    without,
)

_ZERO, _ONE, _HALF, _MM = (np.float32(n) for n in (0.0, 1.0, 0.5, 0.001))
_TWO_PI, _FAR, _MOST_HAZE_M = np.float32(6.28318530718), np.float32(1e4), np.float32(0.04)
_SKIN_ALBEDO, _USUAL_M, _DARKEST = np.float32(0.6), np.float32(0.9), np.float32(0.04)


@np.errstate(under="ignore")
def any_camera_edges(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Simulates silhouettes, shadows and infrared light of an unknown depth camera."""
    x, y = pixels(view.window)
    clean = layers["clean"]
    step = _MM * p["step_mm_per_m"] * clean
    bumps = lattice_noise(view.window, (p["rough_length_px"],) * 2, view.seed)
    growth = p["growth_px"] + p["rough_px"] * bumps + (normal_share(bumps) - _HALF)

    to_front, to_behind = np.full_like(clean, _FAR), np.full_like(clean, _FAR)
    front, behind = np.full_like(clean, _FAR), np.zeros_like(clean)
    for dx, dy in square(2):
        away = np.sqrt(np.float32(dx * dx + dy * dy)) - _HALF
        there, _ = _seen(view, layers, dx, dy)
        nearer = (there > 0) & ((clean <= 0) | (there < clean - step))
        farther = (clean > 0) & ((there <= 0) | (there > clean + step))
        front = np.where(nearer & (away <= growth), np.minimum(front, there), front)
        to_front = np.where(nearer, np.minimum(to_front, away), to_front)
        behind = np.where(farther & (away < to_behind), there, behind)
        to_behind = np.where(farther, np.minimum(to_behind, away), to_behind)
    chance = [uniform01(word) for word in random_bits(x, y, view.seed, 1)]
    grows = front < _FAR
    shrinks = ~grows & (to_behind <= -growth)
    band = np.maximum(growth, _ZERO) + p["cut_px"]
    cut = ~grows & (clean > 0) & (p["cut_px"] > 0) & (to_front <= band)
    lost = shrinks & ((behind <= 0) | (chance[0] < p["edge_holes"]))
    own = np.where(grows, front, np.where(shrinks, behind, clean))

    own_step = _MM * p["step_mm_per_m"] * own
    mixes = (np.minimum(to_front, to_behind) < _FAR) & (p["psf_px"] > 0)
    blended, mixed, light = _mixed(view, layers, own, own_step, p)
    blended, mixed = np.where(mixes, blended, own), np.where(mixes & (own > 0), mixed, _ZERO)
    light = np.where(mixes, light, _seen(view, layers, 0, 0)[1])
    z = np.where(mixed > 0, np.maximum(blended, np.float32(0.05)), own)
    z, least = _hazed(view, layers, z, own, light, p)

    shadowed = ~grows & (clean > 0) & (layers["lit"] < p["shadow_lit"])
    between = shadowed & (chance[2] < p["shadow_between"])
    z = np.where(between, mix(z, least, chance[3]), z)

    other = np.abs(z - clean) > np.maximum(own_step, step)
    reason = np.where(other, np.float32(Reason.MOVED), np.float32(Reason.VALID))
    reason = np.where(clean <= 0, np.float32(Reason.GROWN), reason)
    reason = np.where(mixed > p["max_mixed"], np.float32(Reason.MIXED), reason)
    reason = np.where(lost | cut, np.float32(Reason.EDGE), reason)
    hidden = shadowed & ~(chance[1] < p["shadow_kept"])
    reason = np.where(hidden, np.float32(Reason.SHADOW), reason)
    nothing = np.where(clean > 0, np.float32(Reason.EDGE), np.float32(Reason.NO_SURFACE))
    reason = np.where(own <= 0, nothing, reason)
    valid = np.isin(reason, [r for r in Reason if r.has_depth])
    return {
        "depth": np.where(valid, z, _ZERO),
        "reason": reason,
        "infrared": _infrared(view, layers, p, light),
    }


def _seen(view: FrameContext, layers: Layers, dx: int, dy: int) -> tuple[Image, Image]:
    """Return clean depth, m, of each pixel's neighbour, and its light if it faced the camera."""
    there, albedo = (beside(view, layers[n], dx, dy, clamped=True) for n in ("clean", "albedo"))
    facing = np.array([0.0, 0.0, -1.0], np.float32)
    return there, skin_signal(there, albedo, facing, np.zeros(2, np.float32))


def _mixed(
    view: FrameContext, layers: Layers, own: Image, own_step: Image, p: Parameters
) -> tuple[Image, Image, Image]:
    """Mix depths under the point spread: depth, m, share of other surfaces, and collected light."""
    zeros: Image = np.zeros_like(own)
    total = alike = light = cosines = sines = zeros
    area = _ZERO
    falls = np.float32(-0.5) / np.maximum(p["psf_px"] * p["psf_px"], np.float32(1e-6))
    for dx, dy in square(2):
        there, bright = _seen(view, layers, dx, dy)
        share = np.exp(falls * np.float32(dx * dx + dy * dy))
        counts = _ONE + p["light_mix"] * (bright - _ONE)
        weight: Image = np.where(there > 0, share * counts, _ZERO)
        angle = _TWO_PI * (there - own) / p["wavelength_m"]
        cosines = cosines + weight * np.cos(angle)
        sines = sines + weight * np.sin(angle)
        total = total + weight
        alike = alike + np.where(np.abs(there - own) <= own_step, weight, _ZERO)
        area = area + share
        light = light + share * bright
    blended: Image = own + np.arctan2(sines, cosines) * p["wavelength_m"] / _TWO_PI
    mixed = (_ONE - alike / np.maximum(total, np.float32(1e-6))).astype(np.float32)
    collected: Image = light / area
    return blended, mixed, collected


def _hazed(
    view: FrameContext, layers: Layers, z: Image, own: Image, light: Image, p: Parameters
) -> tuple[Image, Image]:
    """Pull depth towards the surroundings by stray light; return also the least depth around, m."""
    around, pull, least = np.zeros_like(z), np.zeros_like(z), layers["clean"]
    for n in range(8):
        angle, reach = 0.785398163 * n, float(p["haze_px"]) * (1.0 if n % 2 == 0 else 0.6)
        dx, dy = (int(np.floor(reach * way + 0.5)) for way in (np.cos(angle), np.sin(angle)))
        there, bright = _seen(view, layers, dx, dy)
        around = around + np.float32(0.125) * bright
        pull = pull + np.float32(0.125) * bright * (there - z)
        least = np.where(there > 0, np.minimum(least, there), least)
    moved = p["haze"] * pull / np.maximum(light + p["haze"] * around, _MM)
    return z + np.where(own > 0, np.clip(moved, -_MOST_HAZE_M, _MOST_HAZE_M), _ZERO), least


def _infrared(view: FrameContext, layers: Layers, p: Parameters, light: Image) -> Image:
    """Compute infrared counts with read noise and shot noise, 0 to 65535."""
    direction = _direction(layers["rays"])
    squared = (direction * direction).sum(axis=-1, dtype=np.float32)
    facing = np.maximum(-(layers["normal"][..., :3] * direction).sum(axis=-1), _ZERO)
    facing = facing / np.sqrt(squared) * layers["lit"]
    counts = p["gain_counts"] * light * np.where(layers["clean"] > 0, facing, _ONE) / squared
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 2)
    sigma = np.sqrt(p["read_counts"] * p["read_counts"] + p["shot_counts"] * counts)
    noisy = np.floor(counts + sigma * normal_pair(first, second)[0] + _HALF)
    clipped: Image = np.clip(noisy, _ZERO, np.float32(65535.0))
    return clipped


def _direction(rays: Image) -> Image:
    """Return (h, w, 3) directions of the pixels, with z = 1."""
    return np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)


def skin_signal(depth: Image, albedo: Image, normal: Image, ray: Image) -> Image:
    """Compute the returned light, 1 for skin that faces the camera at 0.9 m; as skin_signal.glsl.

    Args:
        normal: (..., 3).
        ray: (..., 2).
    """
    direction = _direction(ray)
    squared = (direction * direction).sum(axis=-1, dtype=np.float32)
    facing = np.maximum(-(normal * direction).sum(axis=-1, dtype=np.float32), _ZERO)
    near = _USUAL_M / np.maximum(depth, _MM)
    light = albedo / _SKIN_ALBEDO * (facing / np.sqrt(squared)) * near * near / squared
    return np.where(depth > 0, light, _ZERO)


@np.errstate(under="ignore")
def any_camera_noise(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise and a systematic error, as of an unknown depth camera."""
    z, normal = layers["depth"], layers["normal"][..., :3]
    known = (normal * normal).sum(axis=-1) > 0
    light = skin_signal(np.full_like(z, _USUAL_M), layers["albedo"], normal, layers["rays"])
    light = np.where(known, np.maximum(light, _DARKEST), _ONE)
    ratio = np.maximum(z, _MM) / _USUAL_M
    by_light = p["light_mm"] * np.power(ratio, p["distance_power"])
    by_light = by_light * np.power(light, -p["light_power"])
    by_inverse = np.float32(1000.0) * p["inverse_per_m"] * z * z
    sigma = p["floor_mm"] * p["floor_mm"] + by_light * by_light + by_inverse * by_inverse
    sigma = np.sqrt(sigma)
    sigma = np.minimum(sigma, p["max_sigma_mm"])
    bits = random_bits(*pixels(view.window), view.seed, 0)
    white, scale = normal_pair(bits[0], bits[1])
    spacing = p["length_x_px"], p["length_y_px"]
    field = np.sqrt(_ONE - p["static_share"]) * lattice_noise(view.window, spacing, view.seed)
    stays = lattice_noise(view.window, spacing, (view.device_seed + 1) % 2**32)
    field = field + np.sqrt(p["static_share"]) * stays
    noise = np.sqrt(p["white_share"]) * white + np.sqrt(_ONE - p["white_share"]) * field
    noise = noise * np.exp(p["tail"] * scale - p["tail"] * p["tail"])
    smooth = lattice_noise(view.window, (p["smooth_px"],) * 2, (view.seed + 1) % 2**32)
    error = sigma * noise + p["smooth_mm"] * smooth
    far_off = uniform01(pcg_word(bits[0])) < p["outlier_share"]
    second = normal_pair(bits[2], bits[3])[0]
    error = error + np.where(far_off, p["outlier_mm"] * second, _ZERO)
    written = {"depth": moved_by_mm(z, error + _systematic_mm(view, p, z))}
    if "expected" in layers:
        right = layers["expected"]
        written["expected"] = moved_by_mm(right, _systematic_mm(view, p, right))
    return written


def _systematic_mm(view: FrameContext, p: Parameters, z: Image) -> Image:
    """Compute the systematic depth error at the depths ``z`` (m), mm; positive measures too far."""
    phase = uniform01(pcg_word(np.array([view.device_seed], np.uint32)))
    x, y = (n.astype(np.float32) + _HALF for n in pixels(view.window))
    beside_x = np.float32(2.0) * x / np.float32(view.width) - _ONE
    beside_y = np.float32(2.0) * y / np.float32(view.height) - _ONE
    turns = z / p["wiggle_period_m"] + phase
    wave = np.sin(_TWO_PI * (turns - np.floor(turns)))
    linear = p["offset_mm"] + p["scale_mm_per_m"] * z
    tilted = p["tilt_x_mm"] * beside_x + p["tilt_y_mm"] * beside_y
    error: Image = linear + tilted + p["wiggle_mm"] * wave
    return error


def any_camera_losses(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels and rounds disparities, as an unknown depth camera does."""
    depth, normal, rays = layers["depth"], layers["normal"][..., :3], layers["rays"]
    known = (normal * normal).sum(axis=-1) > 0
    signal = np.where(known, skin_signal(depth, layers["albedo"], normal, rays), _ONE)
    direction = _direction(rays)
    length = np.sqrt((direction * direction).sum(axis=-1))
    cosine = np.where(known, -(normal * direction).sum(axis=-1) / length, _ONE)
    bits = random_bits(*pixels(view.window), view.seed, 0)
    white, second = normal_pair(bits[0], bits[1])
    spacing = (p["cluster_px"],) * 2
    clusters = normal_share(lattice_noise(view.window, spacing, view.seed))
    more = lattice_noise(view.window, spacing, (view.seed + 1) % 2**32)
    limit = p["dark_signal"] * np.exp(p["dark_spread"] * np.float32(0.70710678) * (white + more))
    grazing = cosine < p["grazing_cosine"] + p["grazing_spread"] * second
    dropped = (clusters < p["cluster_share"]) | (uniform01(bits[2]) < p["single_share"])
    reason = np.select(
        [(signal < limit) | grazing, signal > p["saturated_signal"], dropped],
        [np.float32(r) for r in (Reason.LOW_SIGNAL, Reason.SATURATED, Reason.DROPPED)],
        np.float32(Reason.VALID),
    )
    if p["step_px"] > 0:
        per_m = np.float32(1000.0) * p["step_px"] / p["focal_baseline_px_mm"]
        known = np.where(depth > 0, depth, _ONE)
        steps = np.maximum(np.floor(_ONE / (known * per_m) + _HALF), _ONE)
        depth = np.where(depth > 0, _ONE / (per_m * steps), _ZERO)
    return without({**layers, "depth": depth}, reason != Reason.VALID, reason)


def _node(word: Words) -> Image:
    """Convert a random word to a lattice node's number: the sum of four bytes, variance 1."""
    byte = np.uint32(255)
    parts = (word & byte, word >> np.uint32(8) & byte, word >> np.uint32(16) & byte)
    total = parts[0] + parts[1] + parts[2] + (word >> np.uint32(24))
    number: Image = (total.astype(np.float32) - np.float32(510.0)) * np.float32(6.76583e-3)
    return number


def lattice_noise(window: Rect, spacing_px: tuple[np.float32, np.float32], seed: int) -> Image:
    """Return an (h, w) smooth random field of variance 1, interpolated between lattice nodes.

    Args:
        spacing_px: distances of the nodes along x and y.
    """
    key = pcg_word(np.array([seed], np.uint32))
    starts = uniform01(key), uniform01(pcg_word(key))
    weights, firsts, norms = [], [], []
    for place, spacing, start in zip(pixels(window), spacing_px, starts, strict=True):
        at = place.astype(np.float32) / spacing + start
        node = np.floor(at + _HALF)
        t = at - node
        before = _HALF * (_HALF - t) * (_HALF - t)
        after = _HALF * (_HALF + t) * (_HALF + t)
        middle = np.float32(0.75) - t * t
        weights.append((before, middle, after))
        norms.append(before * before + middle * middle + after * after)
        firsts.append((node - 1).astype(np.int64).astype(np.uint32))
    total = np.zeros((window.height, window.width), np.float32)
    for j in range(3):
        row = pcg_word(key ^ pcg_word(firsts[1] + np.uint32(j)))
        along = sum(
            weights[0][i] * _node(pcg_word(row + firsts[0] + np.uint32(i))) for i in range(3)
        )
        total = total + weights[1][j] * along
    field: Image = total / np.sqrt(norms[0] * norms[1])
    return field


def normal_share(n: Image) -> Image:
    """Compute the cumulative normal distribution at ``n``, within 0.0003."""
    inner = np.float32(0.7978846) * (n + np.float32(0.044715) * n * n * n)
    return _HALF + _HALF * np.tanh(inner)
