"""Random fields in space for the relief of hair and cloth and for patterns of garments."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Reals
from glsim.core.seeds import keyed_rng

Pattern = Literal["plain", "mottled", "stripes", "checks", "print"]

#: Cloth differs by this share from place to place, in patches of _PATCH_MM; chosen.
_PATCHES, _PATCH_MM = 0.10, 30.0
#: Widths of a pair of stripes, mm, and contrasts; below 36 mm the meshes cannot carry them; chosen.
_STRIPES_MM, _CONTRAST = (40.0, 90.0), (0.12, 0.4)
#: Carbon black in a print leaves this share of the cloth's reflectivity; chosen.
_PRINT_LEFT: Final = 0.3

#: Odd 32-bit multipliers that spread lattice coordinates over all bits; chosen, prime.
_PRIMES = tuple(np.uint32(p) for p in (0x8DA6B343, 0xD8163841, 0xCB1AB31F))


#: Scale of the logistic distribution with the standard deviation of the noise (0.40, measured:
#: times the square root of 3 over pi), and the mean of its soft plus, measured.
_LOGISTIC, _SOFT_MEAN = 0.22, 1.02


def smooth_noise(points: Reals, seed: int) -> NDArray[np.float32]:
    """Return noise (N,) float32 in [-1, 1] at points (N, 3), with about one bump per unit length.

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


def openings(points: Reals, seed: int) -> NDArray[np.float32]:
    """Return light depths (N,) float32 >= 0 between fibres, exponentially distributed with mean 1.

    Light that falls between fibres is lost at a constant rate (Beer and Lambert), so that the
    depths at which it returns are distributed so. Noise is nearly logistic; the soft plus of a
    logistic number is exponential.
    """
    soft = np.logaddexp(0.0, smooth_noise(points, seed) / np.float32(_LOGISTIC))
    return np.asarray(soft / np.float32(_SOFT_MEAN), np.float32)


def ridges(points: Reals, seed: int) -> NDArray[np.float32]:
    """Return heights (N,) float32 in [-1, 1] with sharp crests, as between locks of hair."""
    return np.asarray(1 - 4 * np.abs(smooth_noise(points, seed)), np.float32).clip(-1, 1)


def pattern_factors(pattern: Pattern, points: Reals, seed: int) -> Reals:
    """Return reflectivity factors (N,) of cloth at points (N, 3) mm, with mean about 1.

    Args:
        pattern: kind of the cloth.
        points: at rest; x to the subject's left, y up, z ahead.
        seed: of widths, places and contrasts.
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
    """Return a stripe pattern in [-1, 1] with soft edges and a period of one unit."""
    return np.asarray(np.clip(2.5 * np.sin(2 * np.pi * place), -1, 1))
