"""The triangles of the skin: grid, crown, and the slits of the eyes and the mouth.

A slit runs along one row between two corner columns. Its vertices are duplicated: the grid's own
vertices form the upper lid or lip, added ones the lower. Rings of vertices lead inwards from both,
and the last ring is closed, so that an open mouth or eye shows no hole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tools.heads.falloff import IntArray
from tools.heads.grid import (
    BUST_KNOT,
    COLUMNS,
    EYE_KNOT,
    HALF_COLUMNS,
    MOUTH_KNOT,
    ROWS,
    SUBNASALE_KNOT,
    TIP_KNOT,
    knot_row,
)

EYE_COLUMNS = (11, 26)  # medial and lateral canthus (x = 17.1 and 45.9 mm)
MOUTH_COLUMN = 17  # the corner of the mouth (x = 26.4 mm)
SLOPE_COLUMN = 36  # from here outwards the shoulders slope; the clavicles are in front
EYE_RINGS = 2
MOUTH_RINGS = 8
SLIT_NONE, SLIT_EYE, SLIT_MOUTH = 0, 1, 2


@dataclass(frozen=True, eq=False)
class SkinTopology:
    """Vertex labels and triangles of the skin.

    Args:
        row, column: (V,) grid position, column signed (positive: the subject's left).
        slit: (V,) the opening that the vertex borders: SLIT_NONE, SLIT_EYE or SLIT_MOUTH.
        ring: (V,) 0 on the skin, 1... inwards from a slit, -1 at the crown's pole.
        low: (V,) whether the vertex is on a lower lid or lip, or on the skin below the mouth.
        faces: (F, 3) int32, counter-clockwise seen from outside.
    """

    row: IntArray
    column: IntArray
    slit: IntArray
    ring: IntArray
    low: np.ndarray
    faces: IntArray


class _MeshBuilder:
    """Collects vertices and triangles."""

    def __init__(self) -> None:
        self.vertices: list[tuple[int, int, int, int, bool]] = []
        self.triangles: list[tuple[int, int, int]] = []

    def vertex(self, row: int, column: int, slit: int, ring: int, low: bool) -> int:
        self.vertices.append((row, column, slit, ring, low))
        return len(self.vertices) - 1

    def quad(self, a: int, b: int, c: int, d: int) -> None:
        """Add two triangles, or one if two corners coincide."""
        for triangle in ((a, b, c), (a, c, d)):
            if len(set(triangle)) == 3:
                self.triangles.append(triangle)


def signed_column(index: int) -> int:
    """Convert a column index 0..COLUMNS-1 to a signed column: left positive, right negative."""
    return index if index <= HALF_COLUMNS else index - COLUMNS


def other_diagonal(row: int, index: int) -> bool:
    """Return whether the cell right of grid position (row, index) is cut along its other diagonal.

    Left and right are mirrored. Across the furrows under the nose and the slope of the shoulders,
    the usual diagonal would make saw teeth.
    """
    left = index < HALF_COLUMNS
    steps = index if left else COLUMNS - 1 - index
    under_nose = knot_row(TIP_KNOT) + 2 <= row < knot_row(SUBNASALE_KNOT)
    slope = row >= knot_row(BUST_KNOT) and steps > SLOPE_COLUMN
    return left == (under_nose or slope)


#: (row, kind, first column, last column) of each slit.
_SLITS: Final = (
    (knot_row(EYE_KNOT), SLIT_EYE, *EYE_COLUMNS),
    (knot_row(EYE_KNOT), SLIT_EYE, -EYE_COLUMNS[1], -EYE_COLUMNS[0]),
    (knot_row(MOUTH_KNOT), SLIT_MOUTH, -MOUTH_COLUMN, MOUTH_COLUMN),
)


def build_topology() -> SkinTopology:
    """Build the topology of the skin."""
    build = _MeshBuilder()
    upper, lower = _grid_vertices(build)
    pole = build.vertex(0, 0, SLIT_NONE, -1, False)
    columns = [signed_column(index) for index in range(COLUMNS)]
    ring_of = list(zip(columns, columns[1:] + columns[:1], strict=True))
    for here, there in ring_of:
        build.quad(pole, upper[0, here], upper[0, there], upper[0, there])
    for row in range(ROWS - 1):
        for index, (here, there) in enumerate(ring_of):
            corners = [lower[row, here], upper[row + 1, here], upper[row + 1, there]]
            corners.append(lower[row, there])
            first = other_diagonal(row, index)
            build.quad(*corners[first:], *corners[:first])
    for row, kind, start, end in _SLITS:
        _line_slit(build, upper, lower, row, kind, start, end)
    table = np.array(build.vertices)
    return SkinTopology(
        row=table[:, 0].astype(np.int32),
        column=table[:, 1].astype(np.int32),
        slit=table[:, 2].astype(np.int32),
        ring=table[:, 3].astype(np.int32),
        low=table[:, 4].astype(bool),
        faces=np.array(build.triangles, dtype=np.int32),
    )


def _grid_vertices(
    build: _MeshBuilder,
) -> tuple[dict[tuple[int, int], int], dict[tuple[int, int], int]]:
    """Add the vertices of the grid; return those above and below a row, which differ at slits."""
    upper: dict[tuple[int, int], int] = {}
    for row in range(ROWS):
        for column in map(signed_column, range(COLUMNS)):
            slit = SLIT_NONE
            for slit_row, kind, start, end in _SLITS:
                slit = kind if row == slit_row and start <= column <= end else slit
            upper[row, column] = build.vertex(row, column, slit, 0, knot_row(MOUTH_KNOT) < row)
    lower = dict(upper)
    for row, kind, start, end in _SLITS:
        for column in range(start + 1, end):
            lower[row, column] = build.vertex(row, column, kind, 0, True)
    return upper, lower


def _line_slit(
    build: _MeshBuilder,
    upper: dict[tuple[int, int], int],
    lower: dict[tuple[int, int], int],
    row: int,
    kind: int,
    start: int,
    end: int,
) -> None:
    """Add the rings inwards from a slit, and the seam that closes the last ring."""
    span = range(start, end + 1)
    top, bottom = {c: upper[row, c] for c in span}, {c: lower[row, c] for c in span}
    for ring in range(1, (EYE_RINGS if kind == SLIT_EYE else MOUTH_RINGS) + 1):
        inner_top = {c: build.vertex(row, c, kind, ring, False) for c in span}
        inner_bottom = dict(inner_top)
        for c in list(span)[1:-1]:
            inner_bottom[c] = build.vertex(row, c, kind, ring, True)
        for c in list(span)[:-1]:
            build.quad(top[c], inner_top[c], inner_top[c + 1], top[c + 1])
            build.quad(inner_bottom[c], bottom[c], bottom[c + 1], inner_bottom[c + 1])
        top, bottom = inner_top, inner_bottom
    for c in list(span)[:-1]:
        build.quad(top[c], bottom[c], bottom[c + 1], top[c + 1])
