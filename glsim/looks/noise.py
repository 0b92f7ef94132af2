"""Smooth random fields in space: the relief of hair and cloth, evaluated once per subject."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

#: Odd 32-bit multipliers that spread lattice coordinates over all bits; chosen, prime.
_PRIMES = tuple(np.uint32(p) for p in (0x8DA6B343, 0xD8163841, 0xCB1AB31F))


#: Scale of the logistic distribution with the standard deviation of the noise (0.40, measured:
#: times the square root of 3 over pi), and the mean of its soft plus, measured.
_LOGISTIC, _SOFT_MEAN = 0.22, 1.02


def smooth_noise(points: Array, seed: int) -> NDArray[np.float32]:
    """Return (N,) float32 noise in [-1, 1] at (N, 3) points, with about one bump per unit length.

    Values at the whole numbers are random, quintic interpolation makes it smooth between them. A
    pure function of its arguments.

    Args:
        seed: the low 32 bits count.
    """
    low = np.floor(points)
    part = (points - low).astype(np.float32)
    fade = part * part * part * (part * (part * 6 - 15) + 10)
    corner = low.astype(np.int64).astype(np.uint32)
    parts = [[corner[:, k] * p, (corner[:, k] + np.uint32(1)) * p] for k, p in enumerate(_PRIMES)]
    start = np.uint32(seed & 0xFFFFFFFF)
    total: NDArray[np.float32] = np.zeros(len(points), np.float32)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                bits = _mixed(parts[0][x] ^ parts[1][y] ^ parts[2][z] ^ start)
                weight = np.ones(len(points), np.float32)
                for k, high in enumerate((x, y, z)):
                    weight *= fade[:, k] if high else 1 - fade[:, k]
                total += weight * bits
    return total


def _mixed(bits: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Map hashed lattice coordinates to [-1, 1] (xor-shift and multiply rounds)."""
    bits = (bits ^ (bits >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
    bits = (bits ^ (bits >> np.uint32(12))) * np.uint32(0x297A2D39)
    bits ^= bits >> np.uint32(15)
    return bits.astype(np.float32) * np.float32(2.0 / 0xFFFFFFFF) - np.float32(1.0)


def openings(points: Array, seed: int) -> NDArray[np.float32]:
    """Return (N,) float32 from 0 on, exponentially distributed with mean 1: how far light gets.

    Light that falls between fibres is lost at a constant rate (Beer and Lambert), so that the
    depths at which it returns are distributed so. Noise is nearly logistic; the soft plus of a
    logistic number is exponential.
    """
    soft = np.logaddexp(0.0, smooth_noise(points, seed) / np.float32(_LOGISTIC))
    return np.asarray(soft / np.float32(_SOFT_MEAN), np.float32)


def ridges(points: Array, seed: int) -> NDArray[np.float32]:
    """Return (N,) float32 in [-1, 1]: sharp crests where noise crosses zero, as between locks."""
    return np.asarray(1 - 4 * np.abs(smooth_noise(points, seed)), np.float32).clip(-1, 1)
