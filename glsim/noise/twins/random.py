"""Twin of shaders/lib/random.glsl: numbers as a function of (pixel, seed, draw), bit for bit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Words = NDArray[np.uint32]


def random_bits(
    x: ArrayLike, y: ArrayLike, seed: int, draw: ArrayLike
) -> tuple[Words, Words, Words, Words]:
    """Four words of bits for whole numbers that are broadcast; at least one-dimensional."""
    a, b, c, d = _mix(_word(x), _word(y), _word(seed), _word(draw))
    sixteen = np.uint32(16)
    return _mix(a ^ (a >> sixteen), b ^ (b >> sixteen), c ^ (c >> sixteen), d ^ (d >> sixteen))


def _word(numbers: ArrayLike) -> Words:
    """A step of a congruential generator modulo 2^32, from whole numbers of any sign."""
    # An array even of one number: NumPy's scalars complain when they wrap around.
    word = np.atleast_1d(np.asarray(numbers, dtype=np.int64)).astype(np.uint32)
    stepped: Words = word * np.uint32(1664525) + np.uint32(1013904223)
    return stepped


def _mix(a: Words, b: Words, c: Words, d: Words) -> tuple[Words, Words, Words, Words]:
    a = a + b * d
    b = b + c * a
    c = c + a * b
    return a, b, c, d + b * c


def pcg_word(word: Words) -> Words:
    """One word of the generator PCG, RXS-M-XS 32."""
    state = word * np.uint32(747796405) + np.uint32(2891336453)
    mixed: Words = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(
        277803737
    )
    return (mixed >> np.uint32(22)) ^ mixed


def uniform01(bits: Words) -> NDArray[np.float32]:
    """Open interval (0, 1), 23 bits."""
    return ((bits >> np.uint32(9)).astype(np.float32) + np.float32(0.5)) * np.float32(
        1.0 / 8388608.0
    )


def normal_pair(first: Words, second: Words) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Two independent standard normal numbers from two words of bits."""
    radius = np.sqrt(np.float32(-2.0) * np.log(uniform01(first)))
    angle = np.float32(6.28318530718) * uniform01(second)
    return radius * np.cos(angle), radius * np.sin(angle)
