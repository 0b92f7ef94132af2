"""Twins of the light stages of a time-of-flight camera: tof_shadow, tof_light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.rect import Rect
from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.layers import Image, Parameters, fetch, pixels
from glsim.noise.numpy_twins.random import pcg_word, uniform01
from glsim.noise.numpy_twins.tof_turns import (
    TWO_PI,
    along_axis,
    distance_of,
    frequencies,
    half_wave_m_mhz,
    phases,
    unwrapped_cycles,
)

_MM = np.float32(0.001)
_FARTHEST_PX = 128


def tof_shadow(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Share of three emitters that lights a pixel, by ray marching in the image."""
    z, whole = layers["clean"], Rect(0, 0, view.width, view.height)
    emitter = np.asarray(view.optics.emitter_m, np.float32)
    baseline = max(np.sqrt((emitter * emitter).sum()), np.float32(1e-6))
    towards = emitter[:2] / max(np.sqrt((emitter[:2] * emitter[:2]).sum()), np.float32(1e-6))
    sides = np.array([-1.0, 0.0, 1.0], np.float32)
    reach = np.float32(view.focal_baseline_px_m) * (
        np.float32(1.0) + _MM * p["spread_mm"] / baseline * sides
    )
    step = np.float32(1.0) / np.maximum(reach, np.float32(1e-3))
    inverse = np.float32(1.0) / np.maximum(z, np.float32(1e-3))
    nearest = np.float32(1.0) / np.maximum(np.float32(view.optics.nearest_m), np.float32(1e-3))
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


def tof_light(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Light of each pixel as one phasor per frequency."""
    side, rays = view.optics.supersample, layers["rays"]
    z = layers["clean"]
    found = np.where(z > 0, layers["lit"], np.float32(1.0))
    light = phasors(view, p, z, layers["normal"], rays, found) * _contrast(view, p, found)
    mixed = (layers["uneven"] > _MM * p["smooth_mm"]) & (side > 1)
    row, column = np.nonzero(mixed)
    total = np.zeros((len(row), 7), np.float32)
    share = np.float32(1.0) / np.float32(side * side)
    around = [_around(view, layers[name], row, column) for name in ("clean", "lit", "normal")]
    for k in range(side * side if mixed.any() else 0):
        seen = layers["fine_seen"][row * side + k // side, column * side + k % side]
        lit, shape = _alike(seen, *around)
        place = np.array([k % side, k // side], np.float32) - np.float32(side // 2)
        aside = place / (np.float32(side) * np.float32(view.optics.focal_px))
        seen_light = phasors(view, p, seen[:, 0], shape, rays[row, column] + aside, lit)
        total += share * seen_light * _contrast(view, p, lit)
    light[mixed] = total
    empty = np.zeros((*z.shape, 1), np.float32)
    return {
        "light_a": light[..., :4],
        "light_b": np.concatenate([light[..., 4:], empty], -1),
        **expected_depth(view, p, layers),
    }


def _contrast(view: StageView, p: Parameters, lit: Image) -> Image:
    """(..., 7) contrast that is left of each part of ``phasors``; that of the amplitude is 1."""
    around = p["indirect"] * (np.float32(1.0) - lit)
    share = (around / np.maximum(lit + around, np.float32(1e-6)))[..., None]
    turn = TWO_PI * frequencies(view) / half_wave_m_mhz() * _MM * p["indirect_spread_mm"]
    turns = np.concatenate([np.repeat(turn, 2), np.zeros(1, np.float32)])
    left: Image = np.float32(1.0) - share * (
        np.float32(1.0) - np.exp(np.float32(-0.5) * turns * turns)
    )
    return left


def _around(
    view: StageView, layer: Image, row: NDArray[np.int64], column: NDArray[np.int64]
) -> Image:
    """(5, N, ...) values of a layer at the four neighbours of N pixels and at the pixels."""
    left, top, width, height = view.window
    parts = []
    for dx, dy in ((0, -1), (-1, 0), (0, 1), (1, 0), (0, 0)):
        x = np.clip(column + left + dx, 0, view.width - 1) - left
        y = np.clip(row + top + dy, 0, view.height - 1) - top
        values = layer[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        values[(x < 0) | (x >= width) | (y < 0) | (y >= height)] = 0.0
        parts.append(values)
    return np.stack(parts)


def _alike(seen: Image, depths: Image, lits: Image, normals: Image) -> tuple[Image, Image]:
    """Light and shape of samples, from the pixel around with the most similar depth."""
    apart = np.where(depths > 0, np.abs(depths - seen[:, 0]), np.float32(1e5))
    alike, some = apart.argmin(axis=0), apart.min(axis=0) < 1e5
    each = np.arange(len(alike))
    facing = np.array([0.0, 0.0, -1.0, 0.0], np.float32)
    shape = np.where(some[:, None], normals[alike, each], facing)
    shape[:, 3] = seen[:, 1]
    return np.where(some, lits[alike, each], np.float32(1.0)), shape


def surface_light(
    view: StageView, p: Parameters, z: Image, shape: Image, ray: Image, lit: Image
) -> tuple[Image, Image]:
    """Amplitude of surface elements, and half the path emitter, surface, camera, m."""
    emitter = np.asarray(view.optics.emitter_m, np.float32)
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


def device_harmonics(view: StageView, p: Parameters) -> tuple[Image, Image, Image, Image]:
    """Four times (3,): real and imaginary part of the second harmonic per frequency; of the fifth.

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


def correlate(view: StageView, p: Parameters, distance_m: Image) -> tuple[Image, Image]:
    """(..., 3) real and imaginary parts of light of amplitude 1 from distances (...), m."""
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
    view: StageView, p: Parameters, z: Image, shape: Image, ray: Image, lit: Image
) -> Image:
    """(..., 7) of surface elements: real and imaginary part per frequency, and amplitude."""
    amplitude, distance = surface_light(view, p, z, shape, ray, lit)
    real, imaginary = correlate(view, p, distance)
    both = np.stack([real, imaginary], axis=-1).reshape(*amplitude.shape, 6)
    together: Image = np.concatenate([amplitude[..., None] * both, amplitude[..., None]], axis=-1)
    return together


def expected_depth(view: StageView, p: Parameters, layers: Layers) -> dict[str, Image]:
    """The layer expected where it is wanted: depth of lit surfaces without noise and blur."""
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
