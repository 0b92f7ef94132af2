"""Reflectivity of cloth from place to place: yarns, stripes, checks and prints."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Array
from glsim.looks.noise import smooth_noise

Pattern = Literal["plain", "mottled", "stripes", "checks", "print"]

#: Cloth differs by this share from place to place, in patches of _PATCH_MM; chosen.
_PATCHES, _PATCH_MM = 0.10, 30.0
#: Widths of a pair of stripes, mm, and contrasts; below 36 mm the meshes cannot carry them; chosen.
_STRIPES_MM, _CONTRAST = (40.0, 90.0), (0.12, 0.4)
#: Carbon black in a print leaves this share of the cloth's reflectivity; chosen.
_PRINT_LEFT: Final = 0.3


def pattern_factors(pattern: Pattern, points: Array, seed: int) -> Array:
    """Return (N,) factors of the reflectivity of cloth at (N, 3) mm, about 1 in the mean.

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


def _waves(place: Array) -> Array:
    """Return stripes with soft edges, -1 to 1, one pair per unit."""
    return np.asarray(np.clip(2.5 * np.sin(2 * np.pi * place), -1, 1))
