"""Places on the procedural head, for its tests."""

from __future__ import annotations

import numpy as np

from glsim.faces.procedural.subject import model


def slit_vertex(kind: int, column: int, low: bool) -> int:
    """A margin vertex of a lid or lip."""
    head = model().template
    here = (head.slit == kind) & (head.ring == 0) & (head.column == column) & (head.low == low)
    return int(np.flatnonzero(here)[0])


def triangle_areas(points: np.ndarray) -> np.ndarray:
    a, b, c = (points[model().template.faces[:, k]].astype(np.float64) for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
