"""Twins of shaders/lib/perlin.glsl, simplex.glsl and field.glsl."""

from __future__ import annotations

import numpy as np

from glsim.noise.twins.layers import Image, mix, pixels
from glsim.noise.twins.random import Words, pcg_word, random_bits, uniform01
from glsim.noise.view import StageView

#: A point or a vector, by its three coordinates, which are broadcast.
Vector = tuple[Image, Image, Image]


def _hash(node: tuple[Words, Words, Words], seed: int) -> Words:
    """Bits of a lattice node. The seed counts modulo 2^32, for octaves count up from it."""
    x, y, z = node
    return pcg_word(pcg_word(pcg_word(np.uint32(seed % 2**32) ^ pcg_word(z)) + y) + x)


def _gradient(bits: Words, offset: Vector) -> Image:
    """The offset's component along a gradient, one of the 12 edges of a cube."""
    h = bits >> np.uint32(28)
    x, y, z = offset
    a = np.where(h < 8, x, y)
    b = np.where(h < 4, y, np.where((h == 12) | (h == 14), x, z))
    return np.where(h & 1, -a, a) + np.where(h & 2, -b, b)


def _fade(t: Image) -> Image:
    """From 0 to 1 over a lattice cell, with no slope or curvature at its ends."""
    slope = t * (t * np.float32(6.0) - np.float32(15.0)) + np.float32(10.0)
    quintic: Image = t * t * t * slope
    return quintic


def _words(whole: Image) -> Words:
    """Whole numbers of any sign modulo 2^32."""
    return whole.astype(np.int64).astype(np.uint32)


def perlin(at: Vector, seed: int) -> Image:
    """Gradient noise on a cubic lattice, about -1 to 1. ``at``: float32."""
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
    """Gradient noise on a lattice of tetrahedra, about -1 to 1. ``at``: float32."""
    skew = _total(at, 1 / 3)
    cell = [np.floor(part + skew) for part in at]
    unskew = _total((cell[0], cell[1], cell[2]), 1 / 6)
    x0, y0, z0 = (part - low + unskew for part, low in zip(at, cell, strict=True))
    xy, yz, xz = (ge.astype(np.int8) for ge in (x0 >= y0, y0 >= z0, x0 >= z0))
    ranks = xy + xz, 1 - xy + yz, 2 - yz - xz
    n = [_words(part) for part in cell]
    total = np.zeros(1, np.float32)
    # A corner is a step away along each axis whose rank is high enough: none, one, two, all.
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
    """Without drift a field a frame, with drift one a sequence."""
    return view.sequence_seed if drift_hz > 0 else view.seed


def field_position(
    view: StageView, lattice_x_px: np.float32, lattice_y_px: np.float32, drift_hz: np.float32
) -> Vector:
    """Where each pixel of the window lies in the field, in lattice cells."""
    x, y = pixels(view.window)
    bits = random_bits(0, 0, field_seed(view, drift_hz), 0xF1E1D)
    start = [np.float32(3.0) * uniform01(word) for word in bits[:3]]
    time = np.float32(view.time_s) * drift_hz
    return (
        start[0] + (x.astype(np.float32) + np.float32(0.5)) / lattice_x_px,
        start[1] + (y.astype(np.float32) + np.float32(0.5)) / lattice_y_px,
        start[2] + time,
    )
