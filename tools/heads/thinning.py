"""Thin the mesh of the template: fewer triangles where it is even, the same on both sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import reduced
from tools.heads.falloff import Array, IntArray
from tools.heads.template import FLIP, PART_EYEBALL, Template

#: Share of the triangles that is kept, but for the eyeballs, whose vertices carry the edge of the
#: iris. Chosen: 0.05 mm between both surfaces on average, and 0.1 % of the pixels beyond 2 mm.
KEPT_SHARE = 0.55


def thinned_triangles(head: Template, landmarks: NDArray[np.integer]) -> IntArray:
    """Return triangles (F', 3) between vertices of the template, landmarks among them.

    They are those of the thinned left half and their mirror image.
    """
    left = head.faces[(head.points[head.faces, 0] >= 0).all(axis=1)]
    eyeball = (head.part == PART_EYEBALL)[left].all(axis=1)
    on_left = landmarks[head.points[landmarks, 0] >= 0]
    _, kept, nearest = reduced(head.points, left[~eyeball], KEPT_SHARE, on_left)
    half = np.concatenate([nearest[kept], left[eyeball]])
    return np.concatenate([half, mirrored_vertices(head)[half][:, ::-1]])


def mirrored_vertices(head: Template) -> IntArray:
    """Find the mirror image of each vertex of the template: (V,) vertices."""
    labels = (head.part, head.low, head.slit, head.ring, np.abs(head.column), head.row)

    def order(points: Array) -> IntArray:
        return np.lexsort((*np.round(points, 5).T, *labels)).astype(np.int32)

    found = np.empty(len(head.points), dtype=np.int32)
    found[order(head.points)] = order(head.points * FLIP)
    return found
