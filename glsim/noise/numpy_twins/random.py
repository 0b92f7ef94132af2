"""Twins of shaders/lib/random.glsl, bit for bit, kernel.glsl and correlated_noise.glsl.

Random numbers from (pixel, seed, draw).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glsim.core.rect import Rect

Words = NDArray[np.uint32]

#: libfreenect2's 3x3 Gaussian: |dx| + |dy| of a neighbour -> weight.
KERNEL = {0: np.float32(0.1195716), 1: np.float32(0.1131098), 2: np.float32(0.1069973)}
KERNEL_UNIT = np.float32(2.99791)


def random_bits(
    x: ArrayLike, y: ArrayLike, seed: int, draw: ArrayLike
) -> tuple[Words, Words, Words, Words]:
    """Four random words for integers that broadcast; the result has at least one dimension."""
    a, b, c, d = _mix(_word(x), _word(y), _word(seed), _word(draw))
    sixteen = np.uint32(16)
    return _mix(a ^ (a >> sixteen), b ^ (b >> sixteen), c ^ (c >> sixteen), d ^ (d >> sixteen))


def _word(numbers: ArrayLike) -> Words:
    """One step of a congruential generator modulo 2^32, from integers of any sign."""
    # Always an array: NumPy warns when scalars overflow.
    word = np.atleast_1d(np.asarray(numbers, dtype=np.int64)).astype(np.uint32)
    stepped: Words = word * np.uint32(1664525) + np.uint32(1013904223)
    return stepped


def _mix(a: Words, b: Words, c: Words, d: Words) -> tuple[Words, Words, Words, Words]:
    a = a + b * d
    b = b + c * a
    c = c + a * b
    return a, b, c, d + b * c


def pcg_word(word: Words) -> Words:
    """One word of the generator PCG (RXS-M-XS 32)."""
    state = word * np.uint32(747796405) + np.uint32(2891336453)
    mixed: Words = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(
        277803737
    )
    return (mixed >> np.uint32(22)) ^ mixed


def uniform01(bits: Words) -> NDArray[np.float32]:
    """Uniform numbers in the open interval (0, 1), with 23 bits."""
    return ((bits >> np.uint32(9)).astype(np.float32) + np.float32(0.5)) * np.float32(
        1.0 / 8388608.0
    )


def normal_pair(first: Words, second: Words) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Two independent standard normal numbers from two random words (Box-Muller)."""
    radius = np.sqrt(np.float32(-2.0) * np.log(uniform01(first)))
    angle = np.float32(6.28318530718) * uniform01(second)
    return radius * np.cos(angle), radius * np.sin(angle)


def correlated_noise(window: Rect, seed: int) -> NDArray[np.float32]:
    """(h, w) white noise after the decoder's 3x3 filter, scaled to variance 1."""
    x = np.arange(window.left, window.left + window.width)[None, :]
    y = np.arange(window.top, window.top + window.height)[:, None]
    noise = np.zeros((window.height, window.width), np.float32)
    for dy in (-1, 0, 1):
        row = pcg_word(np.uint32(seed) ^ pcg_word((y + dy).astype(np.uint32)))
        for dx in (-1, 0, 1):
            bits = pcg_word(row + (x + dx).astype(np.uint32))
            halves = (bits >> np.uint32(16)).astype(np.int64) + (bits & np.uint32(0xFFFF))
            noise += KERNEL[abs(dx) + abs(dy)] * (halves - 0xFFFF).astype(np.float32)
    return KERNEL_UNIT * np.float32(3.73772e-5) * noise
