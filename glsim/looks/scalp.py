"""The scalp of a source as a grid that is fine enough for the relief of hair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.looks.anatomy import Anatomy
from glsim.looks.skin_grid import Anchors, make_grid

#: Longest edge of the grid, mm; most are 3 to 5: 1.5 pixels of a Kinect V2 at 0.9 m.
_EDGE_MM = 7.5
#: Points up to here outside of the mean hairline can carry hair (beards excepted).
_MARGIN_MM = 14.0


@dataclass(frozen=True, eq=False)
class Scalp:
    """The grid that hair grows on.

    Args:
        anchors: (N,) points on the triangles of the source.
        directions: (N, 3) unit vectors from the middle of the skull.
        faces: (F, 3).
        inside_mm: (N,) above the hairline.
    """

    anchors: Anchors
    directions: NDArray[np.float32]
    faces: NDArray[np.int64]
    inside_mm: NDArray[np.float32]


def make_scalp(anatomy: Anatomy) -> Scalp:
    """Lay the grid over the reference head of a source."""
    near = anatomy.above_hairline_mm(anatomy.vertices_mm) > -_MARGIN_MM
    skin = anatomy.outside & ~anatomy.is_in("ear") & ~anatomy.body & near
    chosen = np.asarray(skin[anatomy.faces].all(axis=1))
    grid = make_grid(anatomy.faces, chosen, anatomy.vertices_mm, _EDGE_MM)
    anchors = Anchors(grid.base[grid.anchors.corners], grid.anchors.weights)
    points = anchors.place(anatomy.vertices_mm)
    out = points - anatomy.centre
    directions = (out / np.linalg.norm(out, axis=1, keepdims=True)).astype(np.float32)
    inside = anatomy.above_hairline_mm(points).astype(np.float32)
    return Scalp(anchors, directions, grid.faces, inside)
