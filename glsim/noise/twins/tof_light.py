"""Twins of tof_shadow, tof_light, tof_multipath, shaders/lib/tof.glsl and turns.glsl."""

from __future__ import annotations

import numpy as np

from glsim.core.array_types import Floats
from glsim.core.arrays import of
from glsim.core.depth_map import lit_share
from glsim.noise.frame_context import FrameContext
from glsim.noise.rig_checks import SPEED_OF_LIGHT
from glsim.noise.twins.batch import beside_camera
from glsim.noise.twins.layers import (
    Image,
    Layers,
    Parameters,
    around,
    deep,
    fetch,
    pcg_word,
    pixels,
    uniform01,
)

TWO_PI, _PI = 6.28318530718, 3.14159265359
_GOLDEN_ANGLE = 2.39996322973
#: Half the speed of light, m MHz: divided by a frequency in MHz it is half a wavelength in m.
HALF_WAVE_M_MHZ = SPEED_OF_LIGHT / 2e6
#: Offsets of the pixels from which a sample may copy its normal.
_NEAR = ((0, -1), (-1, 0), (0, 1), (1, 0), (0, 0))
_MOST_TURNS, _FARTHEST_PX = 64, 128

#: Real and imaginary parts of phasors, (..., 3), and amplitudes, (...).
Light = tuple[Image, Image, Image]


def frequencies(view: FrameContext) -> Floats:
    """Return the three modulation frequencies, float32 MHz."""
    return np.asarray(view.modulation_mhz, np.float32)


def phases(real: Image, imaginary: Image) -> Image:
    """Compute the phases of phasors, in cycles from 0 to 1."""
    turns = of(real).arctan2(imaginary, real) / TWO_PI
    return turns - of(real).floor(turns)


def unwrapped_cycles(phase: Image, f: Floats) -> tuple[Image, Image, Image]:
    """Unwrap phases, (..., 3) in 0 to 1, to whole cycles plus phase of each frequency in ``f``."""
    xp, (f0, _, f2) = of(phase), f.tolist()
    ratio, turns_of_third = float(f[0] / f[1]), f[2] / f[1]
    fast = phase[..., 0] + xp.floor(ratio * phase[..., 1] - phase[..., 0] + 0.5)
    best, best_turn = xp.zeros_like(fast) + 1e6, xp.zeros_like(fast)
    for turn in range(_MOST_TURNS):
        third = fast * f2 / f0 + float(np.float32(turn) * turns_of_third) - phase[..., 2]
        misfit = xp.abs(third - xp.floor(third + 0.5))
        best_turn = xp.where(misfit < best - 1e-4, float(turn), best_turn)
        best = xp.minimum(best, misfit)
        following = np.float32(turn + 1) * turns_of_third + np.float32(0.5)
        if abs(following - np.floor(following) - np.float32(0.5)) <= 1e-3:
            break
    fast = fast + best_turn * ratio
    slow = phase[..., 1] + best_turn
    return fast, slow, phase[..., 2] + xp.floor(fast * f2 / f0 - phase[..., 2] + 0.5)


def distance_of(fast: Image, slow: Image, third: Image, f: Floats) -> Image:
    """Compute half the path emitter, surface, camera, m, from unwrapped cycles; f is (3,) MHz."""
    return (fast + slow + third) * HALF_WAVE_M_MHZ / float(f.sum())


def along_axis(view: FrameContext, rays: Image, distance_m: Image) -> Image:
    """Compute depth, m, from half the length of the path emitter, surface, camera."""
    emitter = np.asarray(view.emitter_m, np.float32)
    ex, ey, ez = emitter.tolist()
    xp, x, y = of(rays), rays[..., 0], rays[..., 1]
    path = 2.0 * distance_m
    toward = x * ex + y * ey + ez
    length = xp.sqrt(x * x + y * y + 1.0)
    below = 2.0 * xp.maximum(path * length - toward, 1e-6)
    return (path * path - float((emitter * emitter).sum())) / below


def tof_shadow(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Computes the share of three emitters that lights each pixel, by ray marching in the image."""
    z = layers["clean"]
    if view.batched:
        axis, way, baseline_m = beside_camera(view.emitter_m)
        places = [baseline_m + side * 0.001 * p["spread_mm"] for side in (-1.0, 0.0, 1.0)]
        lights = [(axis, way, place, 1 / 3) for place in places]
        return {"lit": lit_share(z, view.focal_px, lights, 0.001 * p["bias_mm"])}
    emitter = np.asarray(view.emitter_m, np.float32)
    baseline = max(np.sqrt((emitter * emitter).sum()), np.float32(1e-6))
    towards = emitter[:2] / max(np.sqrt((emitter[:2] * emitter[:2]).sum()), np.float32(1e-6))
    sides = np.array([-1.0, 0.0, 1.0], np.float32)
    reach = np.float32(view.focal_baseline_px_m) * (1.0 + 0.001 * p["spread_mm"] / baseline * sides)
    step = np.float32(1.0) / np.maximum(reach, np.float32(1e-3))
    inverse = np.float32(1.0) / np.maximum(z, np.float32(1e-3))
    nearest = np.float32(1.0) / np.maximum(np.float32(view.nearest_m), np.float32(1e-3))
    hidden = np.zeros((*z.shape, 3), np.bool_)
    walking, looking = inverse < nearest, np.ones(z.shape, np.bool_)
    for k in range(1, _FARTHEST_PX + 1):
        line = inverse[..., None] + np.float32(k) * step
        column, row = (
            np.floor(n.astype(np.float32) + np.float32(0.5) + np.float32(k) * way).astype(np.int64)
            for n, way in zip(pixels(view.window), towards, strict=True)
        )
        there = fetch(z, view.window, column, row)
        surface = (np.float32(1.0) / np.maximum(there, np.float32(1e-3)))[..., None]
        before, scale = surface - line, surface * line
        least = 0.001 * p["bias_mm"] * scale
        deepest = np.maximum(0.001 * p["thickness_mm"] * scale, least + step)
        hides = (before >= least) & (before < deepest)
        hidden |= hides & ((there > 0) & looking)[..., None]
        inside = (column >= 0) & (column < view.width) & (row >= 0) & (row < view.height)
        walking = walking & inside & (line.min(axis=-1) < nearest)
        looking = walking
        if not walking.any():
            break
    lit = np.float32(1.0) - hidden.sum(axis=-1).astype(np.float32) * np.float32(1.0 / 3.0)
    return {"lit": np.where(z > 0, lit, np.float32(0.0))}


def tof_light(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Computes the light of each pixel as one phasor per frequency."""
    z, rays = layers["clean"], layers["rays"]
    found = of(z).where(z > 0, layers["lit"], 1.0)
    light = _lit(view, p, found, phasors(view, p, z, layers["normal"], rays, found))
    if view.supersample > 1:
        _add_samples(view, layers, p, light)
    none = of(z).zeros_like(z)
    return {**packed("light", *light, none), **expected_depth(view, p, layers)}


def packed(name: str, real: Image, imaginary: Image, one: Image, other: Image) -> dict[str, Image]:
    """Pack phasors, (..., 3), and two more components into NAME_a and NAME_b, each (..., 4)."""
    parts = [part[..., k] for k in range(3) for part in (real, imaginary)]
    xp = of(one)
    return {
        f"{name}_a": xp.stack(parts[:4], -1),
        f"{name}_b": xp.stack([*parts[4:], one, other], -1),
    }


def _add_samples(view: FrameContext, layers: Layers, p: Parameters, light: Light) -> None:
    """Replace the light, in place, by the mean of samples in pixels that see several surfaces."""
    side, rays = view.supersample, layers["rays"]
    even_m = 0.001 * p["smooth_mm"] * np.maximum(layers["clean"], 1.0) ** 2
    mixed = layers["uneven"] > even_m
    row, column = np.nonzero(mixed)
    totals = [np.zeros((len(row), *part.shape[2:]), np.float32) for part in light]
    share = np.float32(1.0) / np.float32(side * side)
    near = []
    for name in ("clean", "lit", "normal"):
        there = around(view, layers[name], 1, clamped=True)
        near.append(np.stack([there(*to)[row, column] for to in _NEAR]))
    for k in range(side * side if mixed.any() else 0):
        seen = layers["fine_seen"][row * side + k // side, column * side + k % side]
        lit, shape = _alike(seen, *near)
        place = np.array([k % side, k // side], np.float32) - np.float32(side // 2)
        aside = place / (np.float32(side) * np.float32(view.focal_px))
        ray = rays[row, column] + aside
        sample = _lit(view, p, lit, phasors(view, p, seen[:, 0], shape, ray, lit))
        for total, part in zip(totals, sample, strict=True):
            total += share * part
    for part, total in zip(light, totals, strict=True):
        part[mixed] = total


def _lit(view: FrameContext, p: Parameters, lit: Image, light: Light) -> Light:
    """Shorten phasors by indirect light, whose paths differ in length."""
    xp, (real, imaginary, amplitude) = of(lit), light
    around_ = p["indirect"] * (1.0 - lit)
    share = around_ / xp.maximum(lit + around_, 1e-6)
    turns = [
        TWO_PI * f / HALF_WAVE_M_MHZ * 0.001 * p["indirect_spread_mm"]
        for f in xp.vector(frequencies(view), lit)
    ]
    left = xp.stack([1.0 - share * (1.0 - xp.exp(-0.5 * turn * turn)) for turn in turns], -1)
    return real * left, imaginary * left, amplitude


def _alike(seen: Image, depths: Image, lits: Image, normals: Image) -> tuple[Image, Image]:
    """Copy each sample's lit share and normal from the neighbour of the most similar depth."""
    apart = np.where(depths > 0, np.abs(depths - seen[:, 0]), np.float32(1e5))
    alike, nearest = apart.argmin(axis=0), apart.min(axis=0)
    some = nearest < np.where(seen[:, 1] < 0, np.float32(0.1) * seen[:, 0], np.float32(1e5))
    each = np.arange(len(alike))
    facing = np.array([0.0, 0.0, -1.0, 0.0], np.float32)
    shape = np.where(some[:, None], normals[alike, each], facing)
    shape[:, 3] = np.abs(seen[:, 1])  # strands have negative albedos
    return np.where(some, lits[alike, each], np.float32(1.0)), shape


def surface_light(
    view: FrameContext, p: Parameters, z: Image, shape: Image, ray: Image, lit: Image
) -> tuple[Image, Image]:
    """Compute the light that surface elements return.

    Args:
        z: depth, m, 0 = none.
        shape: (..., 4) normal and albedo.
        ray: (..., 2) x/z and y/z.
        lit: share of the emitter that lights the surface, 0 to 1.

    Returns:
        Amplitude; and half the path emitter, surface, camera, m, with all delays.
    """
    ex, ey, ez = np.asarray(view.emitter_m, np.float32).tolist()
    xp, x, y = of(z), ray[..., 0], ray[..., 1]
    stretch = xp.sqrt(x * x + y * y + 1.0)
    dx, dy, dz = z * x - ex, z * y - ey, z - ez
    way = xp.sqrt(dx * dx + dy * dy + dz * dz)
    cosine = -(shape[..., 0] * dx + shape[..., 1] * dy + shape[..., 2] * dz)
    safe = xp.where(z > 0, way, 1.0)
    facing = xp.maximum(cosine / safe, 0.0)
    beyond = xp.minimum(p["flat_to"] - xp.sqrt(x * x + y * y), 0.0)
    profile = p["tail"] + (1.0 - p["tail"]) * xp.exp(beyond / p["fall_off"])
    indirect = p["indirect"] * (1.0 - lit)
    light = lit + indirect
    detour = p["indirect_mm"] * indirect / xp.maximum(light, 1e-6)
    dimmed = light * facing / (safe * safe) * profile * stretch ** -p["vignetting"]
    amplitude = xp.where(z > 0, p["gain"] * shape[..., 3] * dimmed, 0.0)
    delay = 0.001 * (p["offset_mm"] + p["subsurface_mm"] + detour)
    return amplitude, 0.5 * (z * stretch + way) + delay


def device_harmonics(view: FrameContext, p: Parameters) -> list[Image]:
    """Sample the real and imaginary parts of a device's second and fifth harmonics.

    Returns four arrays (..., 3): real and imaginary part of the second, then of the fifth. The
    parameters give the amplitudes and the mean phases; each device differs in phase.
    """
    seed = view.device_seed
    xp = of(seed)
    key = deep(pcg_word(xp.words(seed, seed)))
    turns = uniform01(pcg_word(key + xp.words(xp.range(0, 6, seed))))
    drawn = deep(p["harmonic_phase_spread"]) * (turns - 0.5)
    made = []
    for name, own in (("harmonic_2", drawn[..., :3]), ("harmonic_5", drawn[..., 3:])):
        angle = TWO_PI * (deep(p[f"{name}_phase_deg"]) / 360.0 + own)
        made += [deep(p[name]) * way(angle) for way in (xp.cos, xp.sin)]
    return made


def correlate(view: FrameContext, p: Parameters, distance_m: Image) -> tuple[Image, Image]:
    """Compute phasors of amplitude 1, with harmonics: real and imaginary parts, each (..., 3)."""
    xp = of(distance_m)
    f = xp.vector(frequencies(view), distance_m)
    # Stacked: the image of each frequency is contiguous in memory, which is faster.
    turns = xp.stack([distance_m * f[k] / HALF_WAVE_M_MHZ for k in range(3)], -1)
    angle = TWO_PI * (turns - xp.floor(turns))
    real_2, imaginary_2, real_5, imaginary_5 = device_harmonics(view, p)
    c, s = xp.cos(angle), xp.sin(angle)
    c2, s2 = c * c - s * s, 2.0 * s * c
    c4, s4 = c2 * c2 - s2 * s2, 2.0 * s2 * c2
    c5, s5 = c4 * c - s4 * s, s4 * c + c4 * s
    real, imaginary = c, s
    for r, i, cosine, sine in ((real_2, imaginary_2, c2, s2), (real_5, imaginary_5, c5, s5)):
        real = xp.plus(xp.plus(real, r, cosine), i, sine)
        imaginary = xp.plus(xp.plus(imaginary, -r, sine), i, cosine)
    return real, imaginary


def phasors(
    view: FrameContext, p: Parameters, z: Image, shape: Image, ray: Image, lit: Image
) -> Light:
    """Compute the phasors of the light of surface elements; arguments as in ``surface_light``."""
    amplitude, distance = surface_light(view, p, z, shape, ray, lit)
    real, imaginary = correlate(view, p, distance)
    return amplitude[..., None] * real, amplitude[..., None] * imaginary, amplitude


def expected_depth(view: FrameContext, p: Parameters, layers: Layers) -> dict[str, Image]:
    """Compute the layer "expected", depth without noise and blur, m; {} if it is not requested."""
    if "expected" not in layers:
        return {}
    z, rays = layers["clean"], layers["rays"]
    xp = of(z)
    _, distance = surface_light(view, p, z, layers["normal"], rays, xp.zeros_like(z) + 1.0)
    f = frequencies(view)
    whole = unwrapped_cycles(phases(*correlate(view, p, distance)), f)
    found = distance_of(*whole, f)
    decoded = along_axis(view, rays, found)
    turn = HALF_WAVE_M_MHZ / float(f.sum())
    right = (xp.abs(found - distance) < 0.5 * turn) & (decoded > 0)
    return {"expected": xp.where(z > 0, xp.where(right, decoded, z), 0.0)}


def tof_multipath(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds light that another visible surface has reflected once."""
    z, shape, light_b = layers["clean"], layers["normal"], layers["light_b"]
    xp = of(z)
    one = xp.zeros_like(z) + 1.0
    rays = xp.stack([layers["rays"][..., 0] * one, layers["rays"][..., 1] * one, one], -1)
    points = z[..., None] * rays
    emitter = xp.vector(view.emitter_m, z)
    focal, radius, count = view.focal_px, p["radius_px"], int(p["samples"])
    per_point = _PI * radius * radius / count
    neighbours = [
        around(view, image, int(radius) + 1) for image in (points, shape, rays, light_b[..., 2])
    ]
    back = xp.sqrt((points * points).sum(-1))
    delay = 0.001 * (p["offset_mm"] + p["subsurface_mm"])
    light_a = layers["light_a"]
    for k in range(count):
        turn = np.float32(_GOLDEN_ANGLE) * np.float32(k)
        far = radius * np.sqrt((np.float32(k) + np.float32(0.5)) / np.float32(count))
        dx, dy = (int(np.floor(far * way(turn) + np.float32(0.5))) for way in (np.cos, np.sin))
        there, there_shape, there_ray, amplitude = (there(dx, dy) for there in neighbours)
        way = there - points
        squared = (way * way).sum(-1)
        apart = xp.sqrt(xp.maximum(squared, 1e-12))
        arriving = xp.maximum((shape[..., :3] * way).sum(-1), 0.0) / apart
        leaving = xp.maximum(-(there_shape[..., :3] * way).sum(-1), 0.0) / apart
        slant = -(there_shape[..., :3] * there_ray).sum(-1)
        far_m = there[..., 2]
        area = per_point * far_m * far_m / (focal * focal) / xp.maximum(slant, 0.05)
        seen = (far_m > 0) & (z > 0)
        share = arriving * leaving * area / xp.where(seen, _PI * squared + area, 1.0)
        amplitude = p["strength"] * shape[..., 3] * amplitude * share
        amplitude = xp.where(seen, amplitude, 0.0)
        outwards = xp.sqrt(((there - emitter) ** 2).sum(-1))
        real, imaginary = correlate(view, p, 0.5 * (outwards + apart + back) + delay)
        real, imaginary = amplitude[..., None] * real, amplitude[..., None] * imaginary
        added = packed("light", real, imaginary, amplitude, xp.zeros_like(z))
        light_a, light_b = light_a + added["light_a"], light_b + added["light_b"]
    return {"light_a": light_a, "light_b": light_b}
