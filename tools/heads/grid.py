"""The grid of the template head: the ray along which each vertex is cast to the surface.

Rows run from the crown down to the shoulders, columns around the head from the midline of the face
(column 0) over the subject's left to the back of the head, and on over the right. Three slits, the
two palpebral fissures and the mouth, are cut along a row: their interior vertices are duplicated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tools.heads.falloff import Array, IntArray, smoothstep

# One line per knot, rows spaced evenly between knots:
# (rows to the next knot, y of the ray's origin, its z in front, its z behind, elevation in front,
#  elevation behind, width factor of the columns). Millimetres and degrees.
ROW_KNOTS: tuple[tuple[int, float, float, float, float, float, float], ...] = (
    (17, 60, -80, -80, 86, 86, 0.0),  # crown (the pole is an extra vertex)
    (9, 60, -45, -105, 34, 34, 0.80),  # hairline
    (8, 60, -40, -110, 0, 0, 0.95),  # forehead
    (4, 36, -40, -110, 0, -4, 1.0),  # brow
    (7, 26, -40, -110, 0, -6, 1.0),
    (7, 15, -40, -110, 0, -8, 1.0),  # palpebral fissure
    (7, 4, -40, -110, 0, -10, 1.0),
    (5, -14, -40, -110, 0, -12, 1.0),
    (12, -20, -40, -110, 0, -12, 1.0),  # tip of the nose
    (5, -29.5, -40, -110, 0, -12, 1.0),  # subnasale
    (6, -40, -40, -108, 0, -12, 0.97),
    (6, -49, -40, -106, 0, -12, 0.93),  # mouth
    (5, -59, -38, -106, 0, -12, 0.85),
    (5, -70, -36, -105, 0, -12, 0.73),
    (6, -83, -24, -104, -4, -12, 0.60),  # chin
    (3, -83, -12, -104, -52, -13, 0.54),  # menton
    (6, -84, -16, -104, -66, -14, 0.52),
    (5, -88, -46, -104, -60, -14, 0.52),  # under the chin
    (7, -106, -70, -104, -20, -12, 0.56),  # throat
    (6, -136, -82, -106, -6, -8, 0.62),  # base of the neck
    (10, -156, -88, -110, 0, -2, 0.8),  # clavicles
    (5, -210, -100, -112, 0, 0, 1.7),
    (9, -258, -108, -115, 0, 0, 2.0),  # chest
    (3, -450, -100, -112, 0, 0, 2.2),  # rounded off downwards
    (0, -450, -100, -112, -75, -75, 1.9),
)
EYE_KNOT, TIP_KNOT, SUBNASALE_KNOT, MOUTH_KNOT, CHIN_KNOT, BUST_KNOT = 5, 8, 9, 11, 14, 19
CHIN_CURVE = 0.02  # 1/mm: setback of the origins of lateral rays, quadratic in x

FRONT_X = np.concatenate([np.arange(12) * 1.55, 18.6 + np.arange(16) * 1.95])  # mm, cast forwards
SIDE_COLUMNS = 20  # columns that fan out to the side
BACK_COLUMNS = 20  # columns around the back to the midline
HALF_COLUMNS = len(FRONT_X) - 1 + SIDE_COLUMNS + BACK_COLUMNS


@lru_cache
def knot_row(knot: int) -> int:
    """Return the row at a knot of ROW_KNOTS."""
    return sum(line[0] for line in ROW_KNOTS[:knot])


ROWS = knot_row(len(ROW_KNOTS) - 1) + 1
COLUMNS = 2 * HALF_COLUMNS


def row_table() -> Array:
    """Return (ROWS, 6): origin y, z in front, z behind, elevation in front, behind (rad), width."""
    knots = np.array([line[1:] for line in ROW_KNOTS], dtype=np.float64)
    at = np.array([knot_row(k) for k in range(len(ROW_KNOTS))], dtype=np.float64)
    rows = np.arange(ROWS)
    table = np.stack([np.interp(rows, at, knots[:, c]) for c in range(6)], axis=1)
    table[:, 3:5] = np.deg2rad(table[:, 3:5])
    return np.asarray(table)


def column_table() -> Array:
    """Return (HALF_COLUMNS + 1, 3): origin x (mm), azimuth (rad, 0 forwards), back weight."""
    side = np.arange(1, SIDE_COLUMNS + 1) / SIDE_COLUMNS
    back = np.arange(1, BACK_COLUMNS + 1) / BACK_COLUMNS
    widest = FRONT_X[-1]
    inner = 0.62 * widest
    x = np.concatenate(
        [FRONT_X, widest + (inner - widest) * side**2, inner * np.cos(back * np.pi / 2)]
    )
    azimuth = np.concatenate([0 * FRONT_X, side * np.pi / 2, (1 + back) * np.pi / 2])
    weight = np.concatenate([0 * FRONT_X, 0.62 * side, 0.62 + 0.38 * back])
    return np.stack([x, azimuth, weight], axis=1)


@dataclass(frozen=True)
class Rays:
    """One ray per vertex: origins (mm) and unit directions (N, 3), for the left half (x >= 0)."""

    origins: Array
    directions: Array


def make_rays(row: IntArray, column: IntArray, shift_y: Array) -> Rays:
    """Return rays at grid positions ``row``, ``|column|`` (N,), moved by ``shift_y`` (N,) mm."""
    table, columns = row_table()[row], column_table()[np.abs(column)]
    x = columns[:, 0] * table[:, 5]
    weight = columns[:, 2]
    y = table[:, 0] + shift_y
    z = table[:, 1] * (1 - weight) + table[:, 2] * weight
    even = smoothstep(1.0, 0.0, row / knot_row(1))  # columns are spaced evenly at the crown
    # the front of the face is narrow towards the chin: lateral rays start farther back
    chin = smoothstep(knot_row(MOUTH_KNOT), knot_row(CHIN_KNOT), row.astype(np.float64))
    z = z - chin * CHIN_CURVE * np.minimum(x, 30.0) ** 2
    azimuth = columns[:, 1] + even * (np.pi * np.abs(column) / HALF_COLUMNS - columns[:, 1])
    x = x * (1 - even)
    level = smoothstep(0.0, np.deg2rad(75.0), azimuth)
    elevation = table[:, 3] * (1 - level) + table[:, 4] * level
    ahead = np.where(columns[:, 1] == 0, x, 1e3)
    y, z, elevation = _fan_under_nose(row, ahead, y, z, elevation)
    directions = np.stack(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ],
        axis=1,
    )
    return Rays(np.stack([x, y, z], axis=1), directions)


def _fan_under_nose(
    row: IntArray, x: Array, y: Array, z: Array, elevation: Array
) -> tuple[Array, Array, Array]:
    """Fan the rays below the nose tip downwards from inside the nose, to reach its underside."""
    first, last = knot_row(TIP_KNOT) - 1, knot_row(SUBNASALE_KNOT)
    along = (row - first) / (last - first)
    inside = (along > 0) & (along < 1)
    forward = np.where(inside, smoothstep(30.0, 21.0, x), 0.0)
    weight = np.where(inside, smoothstep(20.0, 15.0, x), 0.0)
    fan_z = 22.0 - 0.9 * np.minimum(x, 20.0)
    fan_y = np.full_like(y, -17.5) - 0.12 * x
    last_deg = 84.0 - 26.0 * smoothstep(3.0, 12.0, x)
    fan_elevation = -np.deg2rad(4 + (last_deg - 4) * along)
    return (
        y + weight * (fan_y - y),
        z + forward * (fan_z - z),
        elevation + weight * (fan_elevation - elevation),
    )
