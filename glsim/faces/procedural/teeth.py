"""Two smooth rows of teeth, visible only when the lips part.

Millimetres. The arch is a parabola, about 55 mm wide at the second molars and 40 mm deep
(B. G. Burris, E. F. Harris, Angle Orthod. 70, 2000: upper arch width 50-60 mm); upper incisors show
8-9 mm of crown.
"""

from __future__ import annotations

import numpy as np

from glsim.faces.procedural.falloff import Array, IntArray

FRONT_Z = 12.0  # labial face of the upper incisors; about 8 mm behind the lips
HALF_WIDTH = 25.0
DEPTH = 30.0  # distance of the last teeth behind the first
UPPER_EDGES = (-51.3, -42.0)  # biting edge, gum
LOWER_EDGES = (-51.0, -60.0)
OVERJET = 2.0  # mm by which the upper incisors lie in front of the lower
COLUMNS, ROWS = 25, 4


def teeth() -> tuple[Array, IntArray, np.ndarray]:
    """Build both rows: vertices (V, 3), triangles (F, 3), and (V,) whether in the lower row."""
    x = np.linspace(-HALF_WIDTH, HALF_WIDTH, COLUMNS)
    arch = FRONT_Z - DEPTH * np.abs(x / HALF_WIDTH) ** 2.2
    points, faces = [], []
    for lower, (edge, gum) in enumerate((UPPER_EDGES, LOWER_EDGES)):
        share = np.linspace(0.0, 1.0, ROWS)[:, None]
        y = edge + share * (gum - edge) + 0 * x
        z = arch - OVERJET * lower - 1.2 * (1 - share) ** 2 + 0 * y
        first = lower * ROWS * COLUMNS
        points.append(np.stack([x + 0 * y, y, z], axis=-1).reshape(-1, 3))
        index = first + np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
        quads = np.concatenate(
            [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
        )
        faces.append(quads[:, ::-1] if lower else quads)
    low = np.repeat([False, True], ROWS * COLUMNS)
    return np.concatenate(points), np.concatenate(faces).astype(np.int32), low
