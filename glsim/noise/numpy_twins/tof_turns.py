"""Twins of shaders/lib/tof.glsl and turns.glsl: frequencies, whole turns, distance and depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.noise.frame_context import StageView
from glsim.noise.numpy_twins.layers import Image
from glsim.noise.rig_checks import SPEED_OF_LIGHT

TWO_PI = np.float32(6.28318530718)
_MOST_TURNS = 64
_HALF = np.float32(0.5)


def frequencies(view: StageView) -> NDArray[np.float32]:
    """(3,) modulation frequencies, MHz."""
    return np.asarray(view.optics.modulation_mhz, np.float32)


def half_wave_m_mhz() -> np.float32:
    """Half a wavelength times its frequency, m MHz."""
    return np.float32(SPEED_OF_LIGHT / 2e6)


def phases(real: Image, imaginary: Image) -> Image:
    """Phases of phasors, cycles, 0 to 1."""
    turns = (np.arctan2(imaginary, real) / TWO_PI).astype(np.float32)
    within: Image = turns - np.floor(turns)
    return within


def unwrapped_cycles(phase: Image, f: NDArray[np.float32]) -> tuple[Image, Image, Image]:
    """Unwrapped cycles of the fast, slow and third frequency from (..., 3) phases in [0, 1]."""
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
    """Half the path of light, m, from unwrapped cycles."""
    distance: Image = (fast + slow + third) * half_wave_m_mhz() / f.sum()
    return distance


def along_axis(view: StageView, rays: Image, distance_m: Image) -> Image:
    """Depth, m, from half the path emitter, surface, camera."""
    emitter = np.asarray(view.optics.emitter_m, np.float32)
    x, y = rays[..., 0], rays[..., 1]
    path = np.float32(2.0) * distance_m
    toward = x * emitter[0] + y * emitter[1] + emitter[2]
    length = np.sqrt(x * x + y * y + np.float32(1.0))
    below = np.float32(2.0) * np.maximum(path * length - toward, np.float32(1e-6))
    depth: Image = (path * path - (emitter * emitter).sum()) / below
    return depth
