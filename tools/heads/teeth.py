"""Two rows of teeth on their arches, visible when the lips part.

Millimetres. The upper arch is a parabola, 50 mm wide at the first molars and 30 mm deep
(B. G. Burris, E. F. Harris, Angle Orthod. 70, 2000: upper arch width 50-60 mm). Crowns: S. J.
Nelson, "Wheeler's Dental Anatomy", 9th ed. 2010. The gums are the lining of the mouth (mouth.py),
out of which the rows stand.
"""

from __future__ import annotations

import numpy as np

from tools.heads.falloff import Array, IntArray

FRONT_Z = 12.0  # labial face of the upper incisors; about 8 mm behind the lips
ARCH_WIDTH, ARCH_DEPTH, ARCH_POWER = 25.0, 30.0, 2.2
UPPER_EDGE, LOWER_EDGE = -51.3, -51.0  # biting edges of the central incisors
CROWN = 12.5  # crown and the part that the gum hides
OVERJET = 2.0  # mm by which the upper incisors lie in front of the lower
# Central and lateral incisor, canine, two premolars, first molar, from the midline: width along the
# arch, distance of the biting edge from that of the central incisor, thickness.
UPPER_WIDTHS = (8.5, 6.5, 7.5, 7.0, 7.0, 10.0)
LOWER_WIDTHS = (5.0, 5.5, 7.0, 7.0, 7.0, 11.0)
UPPER_EDGES = (0.0, 0.9, 0.1, 0.9, 1.2, 1.6)
LOWER_EDGES = (0.0, 0.1, -0.3, 0.6, 1.0, 1.3)
THICKNESS = (4.0, 4.0, 5.0, 8.0, 8.5, 10.0)
# Samples across a tooth: place, groove between teeth (mm back), rounding of the corners (mm).
ACROSS = ((0.0, 1.0, 1.3), (0.1, 0.35, 0.35), (0.5, 0.0, 0.0), (0.9, 0.35, 0.35))
# Samples around a crown, over the edge from back to front: height above the edge as a share of the
# crown, place between front (0) and back (1), share of the groove.
AROUND = (
    (1.0, 1.0, 0.5), (0.25, 0.8, 0.5), (0.0, 0.5, 0.6), (0.04, 0.2, 1.0), (0.35, 0.0, 1.0),
    (1.0, 0.2, 0.6),
)  # fmt: skip


def arch_point(along: Array) -> tuple[Array, Array, Array]:
    """Return x (N,), z (N,) behind the front, and outward unit normals (N, 2) in x and z.

    Args:
        along: (N,) signed arc length from the midline, positive on the left.
    """
    x = np.linspace(0.0, 1.6 * ARCH_WIDTH, 400)
    z = -ARCH_DEPTH * (x / ARCH_WIDTH) ** ARCH_POWER
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    at = np.interp(np.abs(along), length, x)
    slope = -ARCH_DEPTH * ARCH_POWER / ARCH_WIDTH * (at / ARCH_WIDTH) ** (ARCH_POWER - 1)
    normal = np.stack([-slope, np.ones_like(slope)], axis=1) / np.hypot(slope, 1.0)[:, None]
    side = np.sign(along)
    normal[:, 0] *= side
    return side * at, -ARCH_DEPTH * (at / ARCH_WIDTH) ** ARCH_POWER, normal


def _samples(widths: tuple[float, ...], edges: tuple[float, ...]) -> Array:
    """Return (C, 5) samples along a row: arc length, groove, rounding, edge, thickness."""
    half = []
    start = 0.0
    for width, edge, thick in zip(widths, edges, THICKNESS, strict=True):
        half += [(start + share * width, groove, round_, edge, thick)
                 for share, groove, round_ in ACROSS]  # fmt: skip
        start += width
    half.append((start, *half[0][1:3], edges[-1], THICKNESS[-1]))
    left = np.array(half)
    right = left[:0:-1].copy()
    right[:, 0] *= -1.0
    return np.concatenate([right, left])


def teeth() -> tuple[Array, IntArray, np.ndarray]:
    """Build both rows: vertices (V, 3), triangles (F, 3), and (V,) whether in the lower row."""
    height, behind, grooved = (np.array(column)[:, None] for column in zip(*AROUND, strict=True))
    points: list[Array] = []
    faces, low = [], []
    for lower, (widths, edges, line, front) in enumerate(
        (
            (UPPER_WIDTHS, UPPER_EDGES, UPPER_EDGE, FRONT_Z),
            (LOWER_WIDTHS, LOWER_EDGES, LOWER_EDGE, FRONT_Z - OVERJET),
        )
    ):
        along, groove, rounding, edge, thick = _samples(widths, edges).T
        x, z, normal = arch_point(along)
        back = behind * thick + grooved * groove
        rise = height * CROWN + (edge + rounding * (1.0 - height) ** 4)
        y = line + (-rise if lower else rise)
        first = sum(map(len, points))
        rows = [x - back * normal[:, 0], y + 0 * x, front + z - back * normal[:, 1]]
        points.append(np.stack(rows, axis=-1).reshape(-1, 3))
        index = first + np.arange(y.size).reshape(y.shape)
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
        quads = np.concatenate(
            [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
        )
        faces.append(quads[:, ::-1] if lower else quads)
        low.append(np.full(y.size, lower == 1))
    return np.concatenate(points), np.concatenate(faces).astype(np.int32), np.concatenate(low)
