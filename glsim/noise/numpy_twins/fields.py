"""Twins of shaders/lib/perlin.glsl, simplex.glsl and field.glsl."""

from __future__ import annotations

import numpy as np

from glsim.noise.frame_context import StageView
from glsim.noise.numpy_twins.layers import Image, mix, pixels
from glsim.noise.numpy_twins.random import Words, pcg_word, random_bits, uniform01

#: A point or a vector: its three coordinates, which broadcast.
Vector = tuple[Image, Image, Image]


def _hash(node: tuple[Words, Words, Words], seed: int) -> Words:
    """Hash a lattice node. The seed wraps at 2^32, because each octave adds its number to it."""
    x, y, z = node
    return pcg_word(pcg_word(pcg_word(np.uint32(seed % 2**32) ^ pcg_word(z)) + y) + x)


def _gradient(bits: Words, offset: Vector) -> Image:
    """Dot product of the offset and a gradient, one of the 12 edge directions of a cube."""
    h = bits >> np.uint32(28)
    x, y, z = offset
    a = np.where(h < 8, x, y)
    b = np.where(h < 4, y, np.where((h == 12) | (h == 14), x, z))
    return np.where(h & 1, -a, a) + np.where(h & 2, -b, b)


def _fade(t: Image) -> Image:
    """Quintic fade from 0 to 1 over a lattice cell, without slope or curvature at its ends."""
    slope = t * (t * np.float32(6.0) - np.float32(15.0)) + np.float32(10.0)
    quintic: Image = t * t * t * slope
    return quintic


def _words(whole: Image) -> Words:
    """Integers of any sign, modulo 2^32."""
    return whole.astype(np.int64).astype(np.uint32)


def perlin(at: Vector, seed: int) -> Image:
    """Perlin noise on a cubic lattice, about -1 to 1.

    Args:
        at: float32, in lattice cells.
    """
    whole = [np.floor(part) for part in at]
    f = [part - start for part, start in zip(at, whole, strict=True)]
    n = [_words(part) for part in whole]
    tx, ty, tz = (_fade(part) for part in f)
    low, high = np.uint32(0), np.uint32(1)
    rows = []
    for y, z in ((low, low), (high, low), (low, high), (high, high)):
        left, right = (
            _gradient(
                _hash((n[0] + x, n[1] + y, n[2] + z), seed),
                (f[0] - np.float32(x), f[1] - np.float32(y), f[2] - np.float32(z)),
            )
            for x in (low, high)
        )
        rows.append(mix(left, right, tx))
    return mix(mix(rows[0], rows[1], ty), mix(rows[2], rows[3], ty), tz)


def _total(vector: Vector, factor: float) -> Image:
    by = np.float32(factor)
    total: Image = vector[0] * by + vector[1] * by + vector[2] * by
    return total


def simplex(at: Vector, seed: int) -> Image:
    """Simplex noise on a lattice of tetrahedra, about -1 to 1.

    Args:
        at: float32, in lattice cells.
    """
    skew = _total(at, 1 / 3)
    cell = [np.floor(part + skew) for part in at]
    unskew = _total((cell[0], cell[1], cell[2]), 1 / 6)
    x0, y0, z0 = (part - low + unskew for part, low in zip(at, cell, strict=True))
    xy, yz, xz = (ge.astype(np.int8) for ge in (x0 >= y0, y0 >= z0, x0 >= z0))
    ranks = xy + xz, 1 - xy + yz, 2 - yz - xz
    n = [_words(part) for part in cell]
    total = np.zeros(1, np.float32)
    # The corners follow the coordinates by rank: a step along no axis, one, two, all three.
    for least, back in ((3, 0.0), (2, 1 / 6), (1, 1 / 3), (0, 0.5)):
        step = [rank >= least for rank in ranks]
        x, y, z = (
            part - one.astype(np.float32) + np.float32(back)
            for part, one in zip((x0, y0, z0), step, strict=True)
        )
        t = np.maximum(np.float32(0.5) - (x * x + y * y + z * z), np.float32(0.0))
        bits = _hash((n[0] + step[0], n[1] + step[1], n[2] + step[2]), seed)
        total = total + t * t * t * t * _gradient(bits, (x, y, z))
    return np.float32(76.0) * total


def field_seed(view: StageView, drift_hz: np.float32) -> int:
    """The seed of the field: one field per frame without drift, one per sequence with drift."""
    return view.sequence_seed if drift_hz > 0 else view.seed


def field_position(
    view: StageView, lattice_x_px: np.float32, lattice_y_px: np.float32, drift_hz: np.float32
) -> Vector:
    """Position of each pixel of the window in the field, in lattice cells."""
    x, y = pixels(view.window)
    bits = random_bits(0, 0, field_seed(view, drift_hz), 0xF1E1D)
    start = [np.float32(3.0) * uniform01(word) for word in bits[:3]]
    time = np.float32(view.time_s) * drift_hz
    return (
        start[0] + (x.astype(np.float32) + np.float32(0.5)) / lattice_x_px,
        start[1] + (y.astype(np.float32) + np.float32(0.5)) / lattice_y_px,
        start[2] + time,
    )
