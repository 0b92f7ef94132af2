"""Random fields in space for the relief of hair and cloth, and for patterns of garments."""

from __future__ import annotations

from itertools import product
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats, Reals
from glsim.core.seeds import keyed_rng

Pattern = Literal["plain", "mottled", "stripes", "checks", "print"]

#: Relative variation of cloth's reflectivity in patches, and size of a patch, mm. Chosen.
_PATCHES, _PATCH_MM = 0.10, 30.0
#: Ranges of the width of a pair of stripes, mm, and of the contrast. Chosen: meshes are too coarse
#: for pairs of less than 36 mm.
_STRIPES_MM, _CONTRAST = (40.0, 90.0), (0.12, 0.4)
#: Reflectivity of a carbon-black print relative to the cloth. The value was chosen.
_PRINT_LEFT: Final = 0.3

#: Odd 32-bit multipliers that spread lattice coordinates over all bits; primes were chosen.
_PRIMES = tuple(np.uint32(p) for p in (0x8DA6B343, 0xD8163841, 0xCB1AB31F))


def smooth_noise(points: Reals, seed: int) -> Floats:
    """Compute smooth noise, (N,) float32 from -1 to 1, with about one bump per unit length.

    At (N, 3) points with whole coordinates it is random; quintic weights interpolate between these.
    Only the low 32 bits of the seed count.
    """
    low = np.floor(points)
    away = (points - low).astype(np.float32)
    fade = away * away * away * (away * (away * 6 - 15) + 10)
    corner = low.astype(np.int64).astype(np.uint32)
    words = [[corner[:, k] * p, (corner[:, k] + np.uint32(1)) * p] for k, p in enumerate(_PRIMES)]
    start = np.uint32(seed & 0xFFFFFFFF)
    total: Floats = np.zeros(len(points), np.float32)
    for x, y, z in product((0, 1), repeat=3):
        bits = _mixed(words[0][x] ^ words[1][y] ^ words[2][z] ^ start)
        weight = np.ones(len(points), np.float32)
        for k, high in enumerate((x, y, z)):
            weight *= fade[:, k] if high else 1 - fade[:, k]
        total += weight * bits
    return total


def _mixed(bits: NDArray[np.uint32]) -> Floats:
    """Map hashed lattice coordinates to [-1, 1] (rounds of xor-shift and multiply)."""
    bits = (bits ^ (bits >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
    bits = (bits ^ (bits >> np.uint32(12))) * np.uint32(0x297A2D39)
    bits ^= bits >> np.uint32(15)
    return bits.astype(np.float32) * np.float32(2.0 / 0xFFFFFFFF) - np.float32(1.0)


def smooth_step(value: Reals, low: float, high: float) -> Reals:
    """Interpolate smoothly from 0 at ``low`` to 1 at ``high`` (smoothstep)."""
    share = np.clip((value - low) / (high - low), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


def pattern_factors(pattern: Pattern, points: Reals, seed: int) -> Reals:
    """Compute the reflectivity of patterned cloth, (N,) factors that are about 1 on average.

    Points are (N, 3) mm at rest: x to the subject's left, y up, z forward. The seed decides widths,
    positions and contrasts.
    """
    factors = 1 + _PATCHES * smooth_noise(points / _PATCH_MM, seed).astype(np.float64)
    rng = keyed_rng(seed, "pattern")
    period, contrast = rng.uniform(*_STRIPES_MM), rng.uniform(*_CONTRAST)
    if pattern == "mottled":
        factors += 0.18 * smooth_noise(points / 14.0, seed + 1)
    elif pattern in ("stripes", "checks"):
        factors += contrast * _waves(points[:, 1] / period)
        if pattern == "checks":
            around = np.arctan2(points[:, 0], points[:, 2] - points[:, 2].mean()) * 150.0
            factors += contrast * _waves(around / period)
    elif pattern == "print":
        middle = np.array([points[:, 0].mean(), points[:, 1].max() - rng.uniform(190, 260)])
        size = rng.uniform(60, 110)
        inside = np.abs(points[:, :2] - middle).max(axis=1) < size
        inside &= points[:, 2] > points[:, 2].mean()
        drawn = smooth_noise(points / rng.uniform(22, 50), seed + 2) > -0.15
        factors[inside & drawn] *= _PRINT_LEFT
    return factors


def _waves(place: Reals) -> Reals:
    """Compute stripes with soft edges, -1 to 1, with a period of 1."""
    return np.asarray(np.clip(2.5 * np.sin(2 * np.pi * place), -1, 1))
