"""Twin of shaders/lib/lattice_noise.glsl."""

from __future__ import annotations

import numpy as np

from glsim.core.rect import Rect
from glsim.noise.numpy_twins.layers import Image, pixels
from glsim.noise.numpy_twins.random import Words, pcg_word, uniform01

_HALF = np.float32(0.5)


def _node(word: Words) -> Image:
    """A node's number: the sum of four bytes, scaled to variance 1."""
    byte = np.uint32(255)
    parts = (word & byte, word >> np.uint32(8) & byte, word >> np.uint32(16) & byte)
    total = parts[0] + parts[1] + parts[2] + (word >> np.uint32(24))
    number: Image = (total.astype(np.float32) - np.float32(510.0)) * np.float32(6.76583e-3)
    return number


def lattice_noise(window: Rect, spacing_px: tuple[np.float32, np.float32], seed: int) -> Image:
    """Return an (h, w) field of variance 1.

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
    """The share of a normal variable that lies below ``n``, within 0.0003."""
    inner = np.float32(0.7978846) * (n + np.float32(0.044715) * n * n * n)
    return _HALF + _HALF * np.tanh(inner)
