"""Vertices and triangle areas of the procedural head, for its tests."""

from __future__ import annotations

import numpy as np

from glsim.faces.procedural.subject import head_model


def slit_vertex(kind: int, column: int, low: bool) -> int:
    """Return the index of a margin vertex of a lid or lip."""
    head = head_model().template
    here = (head.slit == kind) & (head.ring == 0) & (head.column == column) & (head.low == low)
    return int(np.flatnonzero(here)[0])


def triangle_areas(points: np.ndarray) -> np.ndarray:
    """Return (F,) triangle areas, mm2, of a head (V, 3)."""
    a, b, c = (points[head_model().template.faces[:, k]].astype(np.float64) for k in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
