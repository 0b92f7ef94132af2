"""NumPy twins of tof_shadow, tof_light, tof_multipath, shaders/lib/tof.glsl and turns.glsl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.numpy_twins.layers import (
    Image,
    Parameters,
    beside,
    fetch,
    pcg_word,
    pixels,
    uniform01,
)
from glsim.noise.rig_checks import SPEED_OF_LIGHT

TWO_PI, _PI = np.float32(6.28318530718), np.float32(3.14159265359)
_GOLDEN_ANGLE = np.float32(2.39996322973)
_MM, _HALF = np.float32(0.001), np.float32(0.5)
#: The pixels whose shape a sample may have.
_NEAR = ((0, -1), (-1, 0), (0, 1), (1, 0), (0, 0))
_MOST_TURNS, _FARTHEST_PX = 64, 128


def frequencies(view: FrameContext) -> NDArray[np.float32]:
    """Return the three modulation frequencies, float32 MHz."""
    return np.asarray(view.modulation_mhz, np.float32)


def half_wave_m_mhz() -> np.float32:
    """Return half the speed of light, m MHz: divided by a frequency it is half a wavelength."""
    return np.float32(SPEED_OF_LIGHT / 2e6)


def phases(real: Image, imaginary: Image) -> Image:
    """Compute the phases of phasors, in cycles from 0 to 1."""
    turns = (np.arctan2(imaginary, real) / TWO_PI).astype(np.float32)
    within: Image = turns - np.floor(turns)
    return within


def unwrapped_cycles(phase: Image, f: NDArray[np.float32]) -> tuple[Image, Image, Image]:
    """Unwrap (..., 3) phases in [0, 1] to cycles of the fast, the slow and the third frequency."""
    ratio, turns_of_third = f[0] / f[1], f[2] / f[1]
    fast = phase[..., 0] + np.floor(ratio * phase[..., 1] - phase[..., 0] + _HALF)
    best, best_turn = np.full_like(fast, 1e6), np.zeros_like(fast)
    for turn in range(_MOST_TURNS):
        third = fast * f[2] / f[0] + np.float32(turn) * turns_of_third - phase[..., 2]
        misfit = np.abs(third - np.floor(third + _HALF))
        best_turn = np.where(misfit < best - np.float32(1e-4), np.float32(turn), best_turn)
        best = np.minimum(best, misfit)
        following = np.float32(turn + 1) * turns_of_third + _HALF
        if abs(following - np.floor(following) - _HALF) <= 1e-3:
            break
    fast = fast + best_turn * ratio
    slow = phase[..., 1] + best_turn
    return fast, slow, phase[..., 2] + np.floor(fast * f[2] / f[0] - phase[..., 2] + _HALF)


def distance_of(fast: Image, slow: Image, third: Image, f: NDArray[np.float32]) -> Image:
    """Compute half the length of the light's path, m, from unwrapped cycles."""
    distance: Image = (fast + slow + third) * half_wave_m_mhz() / f.sum()
    return distance


def along_axis(view: FrameContext, rays: Image, distance_m: Image) -> Image:
    """Compute depth, m, from half the length of the path emitter, surface, camera."""
    emitter = np.asarray(view.emitter_m, np.float32)
    x, y = rays[..., 0], rays[..., 1]
    path = np.float32(2.0) * distance_m
    toward = x * emitter[0] + y * emitter[1] + emitter[2]
    length = np.sqrt(x * x + y * y + np.float32(1.0))
    below = np.float32(2.0) * np.maximum(path * length - toward, np.float32(1e-6))
    depth: Image = (path * path - (emitter * emitter).sum()) / below
    return depth


def tof_shadow(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Computes the share of three emitters that lights each pixel, by ray marching in the image."""
    z, whole = layers["clean"], Rect(0, 0, view.width, view.height)
    emitter = np.asarray(view.emitter_m, np.float32)
    baseline = max(np.sqrt((emitter * emitter).sum()), np.float32(1e-6))
    towards = emitter[:2] / max(np.sqrt((emitter[:2] * emitter[:2]).sum()), np.float32(1e-6))
    sides = np.array([-1.0, 0.0, 1.0], np.float32)
    reach = np.float32(view.focal_baseline_px_m) * (
        np.float32(1.0) + _MM * p["spread_mm"] / baseline * sides
    )
    step = np.float32(1.0) / np.maximum(reach, np.float32(1e-3))
    inverse = np.float32(1.0) / np.maximum(z, np.float32(1e-3))
    nearest = np.float32(1.0) / np.maximum(np.float32(view.nearest_m), np.float32(1e-3))
    x, y = pixels(view.window)
    hidden = np.zeros((*z.shape, 3), np.bool_)
    walking, looking = inverse < nearest, np.ones(z.shape, np.bool_)
    for k in range(1, _FARTHEST_PX + 1):
        line = inverse[..., None] + np.float32(k) * step
        column = np.floor(x.astype(np.float32) + np.float32(0.5) + np.float32(k) * towards[0])
        row = np.floor(y.astype(np.float32) + np.float32(0.5) + np.float32(k) * towards[1])
        column, row = column.astype(np.int64), row.astype(np.int64)
        there = fetch(z, view.window, column, row)
        surface = (np.float32(1.0) / np.maximum(there, np.float32(1e-3)))[..., None]
        before, scale = surface - line, surface * line
        least = _MM * p["bias_mm"] * scale
        deepest = np.maximum(_MM * p["thickness_mm"] * scale, least + step)
        hides = (before >= least) & (before < deepest)
        hidden |= hides & ((there > 0) & looking)[..., None]
        inside = (column >= 0) & (column < whole.width) & (row >= 0) & (row < whole.height)
        walking = walking & inside & (line.min(axis=-1) < nearest)
        looking = walking
        if not walking.any():
            break
    lit = np.float32(1.0) - hidden.sum(axis=-1).astype(np.float32) * np.float32(1.0 / 3.0)
    return {"lit": np.where(z > 0, lit, np.float32(0.0))}


def tof_light(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Computes the light of each pixel as one phasor per frequency."""
    side, rays = view.supersample, layers["rays"]
    z = layers["clean"]
    found = np.where(z > 0, layers["lit"], np.float32(1.0))
    light = phasors(view, p, z, layers["normal"], rays, found) * _contrast(view, p, found)
    mixed = (layers["uneven"] > _MM * p["smooth_mm"]) & (side > 1)
    row, column = np.nonzero(mixed)
    total = np.zeros((len(row), 7), np.float32)
    share = np.float32(1.0) / np.float32(side * side)
    around = [
        np.stack([beside(view, layers[name], *to, clamped=True)[row, column] for to in _NEAR])
        for name in ("clean", "lit", "normal")
    ]
    for k in range(side * side if mixed.any() else 0):
        seen = layers["fine_seen"][row * side + k // side, column * side + k % side]
        lit, shape = _alike(seen, *around)
        place = np.array([k % side, k // side], np.float32) - np.float32(side // 2)
        aside = place / (np.float32(side) * np.float32(view.focal_px))
        seen_light = phasors(view, p, seen[:, 0], shape, rays[row, column] + aside, lit)
        total += share * seen_light * _contrast(view, p, lit)
    light[mixed] = total
    empty = np.zeros((*z.shape, 1), np.float32)
    return {
        "light_a": light[..., :4],
        "light_b": np.concatenate([light[..., 4:], empty], -1),
        **expected_depth(view, p, layers),
    }


def _contrast(view: FrameContext, p: Parameters, lit: Image) -> Image:
    """Compute the contrast, (..., 7), that indirect light leaves of each part of ``phasors``."""
    around = p["indirect"] * (np.float32(1.0) - lit)
    share = (around / np.maximum(lit + around, np.float32(1e-6)))[..., None]
    turn = TWO_PI * frequencies(view) / half_wave_m_mhz() * _MM * p["indirect_spread_mm"]
    turns = np.concatenate([np.repeat(turn, 2), np.zeros(1, np.float32)])
    left: Image = np.float32(1.0) - share * (
        np.float32(1.0) - np.exp(np.float32(-0.5) * turns * turns)
    )
    return left


def _alike(seen: Image, depths: Image, lits: Image, normals: Image) -> tuple[Image, Image]:
    """Return light and normal of each sample, copied from the neighbour of most similar depth."""
    apart = np.where(depths > 0, np.abs(depths - seen[:, 0]), np.float32(1e5))
    alike, some = apart.argmin(axis=0), apart.min(axis=0) < 1e5
    each = np.arange(len(alike))
    facing = np.array([0.0, 0.0, -1.0, 0.0], np.float32)
    shape = np.where(some[:, None], normals[alike, each], facing)
    shape[:, 3] = seen[:, 1]
    return np.where(some, lits[alike, each], np.float32(1.0)), shape


def surface_light(
    view: FrameContext, p: Parameters, z: Image, shape: Image, ray: Image, lit: Image
) -> tuple[Image, Image]:
    """Compute the amplitude of surface elements, and half the path emitter, surface, camera, m."""
    emitter = np.asarray(view.emitter_m, np.float32)
    x, y = ray[..., 0], ray[..., 1]
    stretch = np.sqrt(x * x + y * y + np.float32(1.0))
    from_emitter = z * x - emitter[0], z * y - emitter[1], z - emitter[2]
    way = np.sqrt(sum((part * part for part in from_emitter), np.float32(0.0)))
    cosine = -(
        shape[..., 0] * from_emitter[0]
        + shape[..., 1] * from_emitter[1]
        + shape[..., 2] * from_emitter[2]
    )
    safe = np.where(z > 0, way, np.float32(1.0))
    facing = np.maximum(cosine / safe, np.float32(0.0))
    beyond = np.minimum(p["flat_to"] - np.sqrt(x * x + y * y), np.float32(0.0))
    profile = p["tail"] + (np.float32(1.0) - p["tail"]) * np.exp(beyond / p["fall_off"])
    around = p["indirect"] * (np.float32(1.0) - lit)
    light = lit + around
    detour = p["indirect_mm"] * around / np.maximum(light, np.float32(1e-6))
    dimmed = light * facing / (safe * safe) * profile * np.power(stretch, -p["vignetting"])
    amplitude = np.where(z > 0, p["gain"] * shape[..., 3] * dimmed, np.float32(0.0))
    delay = _MM * (p["offset_mm"] + p["subsurface_mm"] + detour)
    return amplitude, np.float32(0.5) * (z * stretch + way) + delay


def device_harmonics(view: FrameContext, p: Parameters) -> tuple[Image, Image, Image, Image]:
    """Draw real and imaginary parts of the device's second, then fifth harmonic, (3,) each.

    Sizes are the parameters'; phases are the device's own, drawn around the parameters'.
    """
    key = pcg_word(np.array([view.device_seed], np.uint32))
    turns = uniform01(pcg_word((key + np.arange(6)).astype(np.uint32)))
    drawn = p["harmonic_phase_spread"] * (turns - np.float32(0.5))
    second = TWO_PI * (p["harmonic_2_phase_deg"] / np.float32(360.0) + drawn[:3])
    fifth = TWO_PI * (p["harmonic_5_phase_deg"] / np.float32(360.0) + drawn[3:])
    return (
        p["harmonic_2"] * np.cos(second),
        p["harmonic_2"] * np.sin(second),
        p["harmonic_5"] * np.cos(fifth),
        p["harmonic_5"] * np.sin(fifth),
    )


def correlate(view: FrameContext, p: Parameters, distance_m: Image) -> tuple[Image, Image]:
    """Compute (..., 3) real and imaginary parts of light of amplitude 1 from distances (...), m."""
    turns = distance_m[..., None] * frequencies(view) / half_wave_m_mhz()
    angle = TWO_PI * (turns - np.floor(turns))
    real_2, imaginary_2, real_5, imaginary_5 = device_harmonics(view, p)
    c, s = np.cos(angle), np.sin(angle)
    c2, s2 = c * c - s * s, np.float32(2.0) * s * c
    c4, s4 = c2 * c2 - s2 * s2, np.float32(2.0) * s2 * c2
    c5, s5 = c4 * c - s4 * s, s4 * c + c4 * s
    real = c + real_2 * c2 + imaginary_2 * s2 + real_5 * c5 + imaginary_5 * s5
    imaginary = s - real_2 * s2 + imaginary_2 * c2 - real_5 * s5 + imaginary_5 * c5
    return real, imaginary


def phasors(
    view: FrameContext, p: Parameters, z: Image, shape: Image, ray: Image, lit: Image
) -> Image:
    """Compute (..., 7) light of surface elements: real, imaginary per frequency, and amplitude."""
    amplitude, distance = surface_light(view, p, z, shape, ray, lit)
    real, imaginary = correlate(view, p, distance)
    both = np.stack([real, imaginary], axis=-1).reshape(*amplitude.shape, 6)
    together: Image = np.concatenate([amplitude[..., None] * both, amplitude[..., None]], axis=-1)
    return together


def expected_depth(view: FrameContext, p: Parameters, layers: Layers) -> dict[str, Image]:
    """Return the layer "expected", depth without noise and blur, m; {} if it is not wanted."""
    if "expected" not in layers:
        return {}
    z, rays = layers["clean"], layers["rays"]
    facing = np.broadcast_to(np.array([0.0, 0.0, -1.0, 1.0], np.float32), (*z.shape, 4))
    _, distance = surface_light(view, p, z, facing, rays, np.ones_like(z))
    f = frequencies(view)
    whole = unwrapped_cycles(phases(*correlate(view, p, distance)), f)
    found = distance_of(*whole, f)
    decoded = along_axis(view, rays, found)
    turn = half_wave_m_mhz() / f.sum()
    right = (np.abs(found - distance) < np.float32(0.5) * turn) & (decoded > 0)
    return {"expected": np.where(z > 0, np.where(right, decoded, z), np.float32(0.0))}


def tof_multipath(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds light that another visible surface has reflected once."""
    one = np.ones((*layers["clean"].shape, 1), np.float32)
    z, shape = layers["clean"], layers["normal"]
    rays = np.concatenate([layers["rays"], one], axis=-1)
    points = z[..., None] * rays
    emitter = np.asarray(view.emitter_m, np.float32)
    focal = np.float32(view.focal_px)
    count = int(p["samples"])
    per_point = _PI * p["radius_px"] * p["radius_px"] / np.float32(count)
    light_a, light_b = layers["light_a"].copy(), layers["light_b"].copy()
    for k in range(count):
        turn = _GOLDEN_ANGLE * np.float32(k)
        far = p["radius_px"] * np.sqrt((np.float32(k) + _HALF) / np.float32(count))
        dx, dy = (int(np.floor(far * way(turn) + _HALF)) for way in (np.cos, np.sin))
        there, there_shape, there_ray, amplitude = (
            beside(view, image, dx, dy)
            for image in (points, shape, rays, layers["light_b"][..., 2])
        )
        way = there - points
        squared = (way * way).sum(axis=-1)
        apart = np.sqrt(np.maximum(squared, np.float32(1e-12)))
        arriving = np.maximum((shape[..., :3] * way).sum(axis=-1), np.float32(0.0)) / apart
        leaving = np.maximum(-(there_shape[..., :3] * way).sum(axis=-1), np.float32(0.0)) / apart
        slant = -(there_shape[..., :3] * there_ray).sum(axis=-1)
        area = (
            per_point
            * there[..., 2]
            * there[..., 2]
            / (focal * focal)
            / np.maximum(slant, np.float32(0.05))
        )
        seen = (there[..., 2] > 0) & (z > 0)
        share = arriving * leaving * area / np.where(seen, _PI * squared + area, np.float32(1.0))
        amplitude = p["strength"] * shape[..., 3] * amplitude * share
        amplitude = np.where(seen, amplitude, np.float32(0.0))[..., None]
        outwards = np.sqrt(((there - emitter) ** 2).sum(axis=-1))
        back = np.sqrt((points * points).sum(axis=-1))
        delay = _MM * (p["offset_mm"] + p["subsurface_mm"])
        real, imaginary = correlate(view, p, _HALF * (outwards + apart + back) + delay)
        both = np.stack([real, imaginary], axis=-1).reshape(*z.shape, 6)
        light_a += amplitude * both[..., :4]
        light_b[..., :3] += amplitude * np.concatenate([both[..., 4:], one], axis=-1)
    return {"light_a": light_a, "light_b": light_b}
