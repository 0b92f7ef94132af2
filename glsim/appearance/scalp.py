"""The scalp as a grid of even density, bound to the triangles of a source's heads.

Meshes have 3 to 8 mm between vertices on the scalp, too few for the relief of hair. Rays from the
middle of the skull through the vertices of a geodesic sphere hit the scalp; a grid point follows
the triangle that its ray hit, so that one grid fits every person and every frame of the source.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Anatomy, Array
from glsim.appearance.sphere import geodesic_sphere
from glsim.geometry.products import product

#: 10,242 directions, 3.5 to 4 mm apart on a skull of 95 mm: 1.5 pixels of a Kinect V2 at 0.9 m.
_SUBDIVISIONS = 5
#: Half the width of a cell of the coarse sphere (0.19 rad) and of the largest triangle, rad.
_CELL_RAD = 0.32
#: Points up to here outside of the mean hairline can carry hair (beards excepted).
_MARGIN_MM = 14.0


@dataclass(frozen=True, eq=False)
class Anchors:
    """Points on a mesh: corners (N, 3) vertex indices and their weights (N, 3) float32."""

    corners: NDArray[np.int64]
    weights: NDArray[np.float32]

    def place(self, vertices_mm: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return where the points lie on another mesh of the same source: (N, 3) float32."""
        weights, corners = self.weights, self.corners
        points = weights[:, :1] * vertices_mm[corners[:, 0]]
        points += weights[:, 1:2] * vertices_mm[corners[:, 1]]
        points += weights[:, 2:] * vertices_mm[corners[:, 2]]
        return points

    def taken(self, chosen: NDArray[np.int64]) -> Anchors:
        """Return the anchors of some points."""
        return Anchors(self.corners[chosen], self.weights[chosen])


@dataclass(frozen=True, eq=False)
class Scalp:
    """The grid of rays that hair grows along.

    Args:
        directions: (N, 3) unit rays.
        faces: (F, 3).
        inside_mm: (N,) above the hairline.
    """

    anchors: Anchors
    directions: NDArray[np.float32]
    faces: NDArray[np.int64]
    inside_mm: NDArray[np.float32]


def make_scalp(anatomy: Anatomy) -> Scalp:
    """Lay the grid over the reference head of a source."""
    rays, sphere_faces = geodesic_sphere(_SUBDIVISIONS)
    outside = anatomy.outside & ~anatomy.is_in("ear") & ~anatomy.body
    near = anatomy.above_hairline_mm(anatomy.vertices_mm) > -2 * _MARGIN_MM
    triangles = anatomy.faces[outside[anatomy.faces].all(axis=1)]
    triangles = triangles[near[triangles].any(axis=1)]
    hit, weights = _innermost_hits(rays, anatomy.vertices_mm[triangles] - anatomy.centre)
    anchors = Anchors(triangles[hit].astype(np.int64), weights.astype(np.float32))
    points = anchors.place(anatomy.vertices_mm)
    inside = anatomy.above_hairline_mm(points)
    inside[weights.sum(axis=1) == 0] = -1e3
    kept = inside > -_MARGIN_MM
    faces = sphere_faces[kept[sphere_faces].all(axis=1)]
    used, inverse = np.unique(faces, return_inverse=True)
    return Scalp(
        anchors.taken(used),
        rays[used].astype(np.float32),
        inverse.reshape(-1, 3),
        inside[used].astype(np.float32),
    )


def _innermost_hits(rays: Array, corners: Array) -> tuple[NDArray[np.int64], Array]:
    """Return the triangle (N,) that each ray from the origin hits first, and weights (N, 3).

    Ears lie outside of the skull, so that the first hit is under the ear. The weights of a ray that
    hits nothing are 0. Rays are tested in cells of a coarse sphere, against the triangles that
    reach into the cell.

    Args:
        corners: (T, 3, 3).
    """
    units = corners / np.linalg.norm(corners, axis=2, keepdims=True)
    centres = geodesic_sphere(2)[0]
    cell = np.argmax(product(rays, centres.T), axis=1)
    reach = np.cos(_CELL_RAD)
    chosen = np.zeros(len(rays), np.int64)
    weights = np.zeros((len(rays), 3))
    for number, centre in enumerate(centres):
        mine = np.flatnonzero(cell == number)
        near = np.flatnonzero(product(units, centre).max(axis=1) > reach)
        if len(mine) == 0 or len(near) == 0:
            continue
        a, b, c = np.moveaxis(corners[near], 1, 0)
        # Solve u a + v b + w c = ray for each triangle; all positive: the ray passes inside.
        volume = np.einsum("ki,ki->k", a, np.cross(b, c))
        volume[np.abs(volume) < 1e-9] = np.inf
        solved = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) / volume[:, None]
        uvw = np.moveaxis(product(solved, rays[mine].T), 0, 2)  # (triangles, rays, 3)
        total = uvw.sum(axis=2)
        inside = (uvw.min(axis=2) >= -1e-6) & (total > 1e-9)
        first = np.argmax(np.where(inside, total, -1.0), axis=0)  # total is 1 over the distance
        column = np.arange(len(mine))
        found = inside[first, column]
        chosen[mine] = near[first]
        weights[mine] = uvw[first, column] / np.where(found, total[first, column], 1.0)[:, None]
        weights[mine[~found]] = 0.0
    return chosen, weights
