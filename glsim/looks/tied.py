"""Tied hair: buns and tails, as bundles of locks from one place of the scalp."""

from __future__ import annotations

import numpy as np

from glsim.core.products import norm
from glsim.looks.anatomy import Anatomy, Array
from glsim.looks.locks import Locks, make_ribbons
from glsim.looks.styles import HairStyle

#: Where hair is tied, relative to the eyes of a mean adult, mm; chosen.
_TIES = {
    "bun": ((0.0, 22.0, -198.0),),
    "top bun": ((0.0, 112.0, -120.0),),
    "pony tail": ((0.0, 45.0, -194.0),),
    "twin tails": ((74.0, 40.0, -125.0), (-74.0, 40.0, -125.0)),
}


def tied_locks(
    anatomy: Anatomy, base: Array, style: HairStyle, rng: np.random.Generator
) -> list[Locks]:
    """Return the bundles of a style; none for hair that is not tied."""
    bundles = []
    for place in _TIES.get(style.extra, ()):
        tie = anatomy.eye + np.array(place) * anatomy.scale
        root = int(np.argmin(np.linalg.norm(base - tie, axis=1)))
        out = base[root] - anatomy.centre
        out /= norm(out)
        tie = base[root] + 6.0 * anatomy.scale * out
        if "bun" in style.extra:
            lines, width = _bun(tie, out, anatomy.scale, rng)
        else:
            lines, width = _tail(tie, out, anatomy.scale, rng)
        roots = np.full(lines.shape[1], root)
        bundles.append(make_ribbons(lines, width, roots, anatomy.centre, closed=True))
    return bundles


def _bun(tie: Array, out: Array, scale: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Wind 26 locks around a ball."""
    radius = rng.uniform(24, 34) * scale
    middle = tie + 0.75 * radius * out
    axis = rng.normal(0, 1, (26, 3)) + 2.0 * out
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    first = np.cross(axis, rng.normal(0, 1, (26, 3)))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axis, first)
    turn = np.linspace(0, 1.6 * np.pi, 10)[:, None, None]
    high = rng.uniform(-0.9, 0.9, 26)[None, :, None]
    ring = np.sqrt(1 - high**2) * (np.cos(turn) * first + np.sin(turn) * second) + high * axis
    return middle + radius * rng.uniform(0.88, 1.06, (1, 26, 1)) * ring, np.full(26, 17.0 * scale)


def _tail(tie: Array, out: Array, scale: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Hang 34 locks from a tie, in an arc away from the head."""
    length = rng.uniform(150, 290) * scale * rng.uniform(0.7, 1.0, 34)
    share = np.linspace(0, 1, 12)[:, None, None]
    spread = rng.normal(0, 1, (1, 34, 3)) * np.array([11.0, 4.0, 9.0]) * scale
    arc = out * (34 * scale) * np.sin(np.clip(2.2 * share, 0, 1) * np.pi / 2)
    drop = np.array([0.0, -1.0, 0.0]) * length[None, :, None] * np.clip(share - 0.08, 0, 1)
    lines = tie + arc + drop + spread * (0.25 + 1.1 * np.sqrt(share))
    return lines, rng.uniform(9, 15, 34) * scale
