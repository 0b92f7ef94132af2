"""The lids of procedural heads: vertices that slide over the eyeball when the eye closes.

The skin of a closing lid moves along the neutral surface, and beyond the margin of the open lid
along the eyeball. The motion is a quadratic in the closure a in [0, 1], displacement =
a * linear + a^2 * square, exact at a = 0, 1/2 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array

EYE_RADIUS: Final = 12.0  # mm; Bron, Tripathi & Tripathi 1997, "Wolff's Anatomy of the Eye"
LID_THICKNESS: Final = 1.9  # mm; Bron et al. 1997: about 2 mm at the margin
LID_ROWS: Final = 11  # rows of vertices above or below the slit that a lid can move
LID_REACH_ROWS: Final = 5.0  # rows over which the motion fades
CLOSED_LINE: Final = 0.18  # closed lids meet at this share of the opening above the lower margin
OVERLAP_MM: Final = 0.25  # distance of the closed upper lid's edge below the lower lid's edge


@dataclass(frozen=True, eq=False)
class Lids:
    """The lid vertices of both eyes: C columns of LID_ROWS vertices, each from the margin outwards.

    Args:
        index: (L,) vertices.
        left: (L,) whether a vertex is on the subject's left.
        strips: (2, C, LID_ROWS) vertices of the upper and the lower lids.
        strip_left: (C,) whether a column belongs to the left eye.
        linings: (2, P, 2) column and vertex of the rings behind the margins.
    """

    index: NDArray[np.int64]
    left: NDArray[np.bool_]
    strips: NDArray[np.int64]
    strip_left: NDArray[np.bool_]
    linings: NDArray[np.int64]


def globe_height(x: Array, y: Array, centers: Array) -> Array:
    """Return the height z of the lids' sphere at (x, y), clamped at its rim; shapes broadcast."""
    radius = EYE_RADIUS + LID_THICKNESS
    away = np.square(x - centers[..., 0]) + np.square(y - centers[..., 1])
    return np.asarray(centers[..., 2] + np.sqrt(np.maximum(radius**2 - away, (0.3 * radius) ** 2)))


def lid_closure(points: Array, centers: Array, lids: Lids) -> list[Array]:
    """Compute a subject's lid-closing offsets: linear and square terms, upper lids then lower.

    Each result is (L, 3) mm for the lid vertices ``lids.index`` of a neutral head (V, 3) mm with
    the left and right eyeball centres (2, 3) mm.
    """
    upper, lower = lids.strips
    gap = np.maximum(points[upper[:, 0], 1] - points[lower[:, 0], 1], 0.0)
    globes = np.where(lids.strip_left[:, None], centers[0], centers[1])
    travels = (gap * (1.0 - CLOSED_LINE) + OVERLAP_MM, gap * CLOSED_LINE)
    results = []
    for number, travel in enumerate(travels):
        half, full = (_slide(points, lids, globes, number, a * travel) for a in (0.5, 1.0))
        results += [4.0 * half - full, 2.0 * full - 4.0 * half]
    return results


def _slide(points: Array, lids: Lids, globes: Array, number: int, travel: Array) -> Array:
    """Return offsets (L, 3) mm of upper (0) or lower (1) lids that close by ``travel`` (C,) mm."""
    strip, (column, lining) = lids.strips[number], lids.linings[number].T
    up = 1.0 if number == 0 else -1.0  # from the margin outwards
    x, y, z = points[strip, 0], up * points[strip, 1], points[strip, 2]
    moved = y - travel[:, None] * np.exp(-np.square(np.arange(LID_ROWS) / LID_REACH_ROWS))
    on_skin = np.array([np.interp(m, a, b) for m, a, b in zip(moved, y, z, strict=True)])
    center = globes[:, None, :]
    edge = globe_height(x[:, :1], up * y[:, :1], center)
    on_globe = z[:, :1] + globe_height(x, up * moved, center) - edge
    height = np.where(moved < y[:, :1], on_globe, on_skin)
    change = np.zeros_like(points)
    change[strip, 1] = up * (moved - y)
    change[strip, 2] = height - z
    change[lining] = change[strip[column, 0]]
    return np.asarray(change[lids.index])
