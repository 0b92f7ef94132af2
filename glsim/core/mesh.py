"""A triangle mesh in the canonical face frame.

Canonical face frame: millimetres, +x the subject's left, +y up, +z out of the face, origin at
the centre of the face. A sensor at distance d sees it through
``p_camera = diag(1, -1, -1) p + (0, 0, d)`` (OpenCV camera axes: x right, y down, z forward).
"""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Floats, Reals, Triangles
from glsim.core.errors import MeshError

#: Albedo of a mesh that has none: diffuse reflectivity of skin at 860 nm relative to a white wall.
#: Skin has 0.5-0.6 (NIST reflectance data, Cooksey 2017), a wall 0.85-0.9.
SKIN_ALBEDO = 0.6
#: Share of the triangles that a reduced mesh has; chosen by the error in docs/results/speed.md.
KEPT_SHARE = 0.44

#: Growth of the library's error bound, 1 to 7 (the default): 5 is the smallest that works.
_AGGRESSIVENESS = 5
#: fast_simplification keeps its mesh in global variables: two threads would mix theirs.
_SIMPLIFYING = Lock()


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh with an optional albedo per vertex.

    Args:
        vertices_mm: (V, 3) float32, canonical frame, millimetres.
        faces: (F, 3) int32 vertex indices, counter-clockwise seen from outside. Meshes of one
            topology should share one array object: the renderer then keeps it on the GPU.
        albedo: (V,) float32 in [0, 1], diffuse reflectivity at 860 nm relative to a white wall, or
            None for SKIN_ALBEDO; plus 4 times the number of a glossy material (lib/gloss.glsl).
        occluder: (F', 3) int32, a smaller list of triangles that casts the shadows, see
            ``occluder_of``; None for ``faces``.
        two_sided: whether the backs of triangles are drawn too. They are for meshes from files,
            which may be open or have triangles in random orders of vertices.
        strands: (V, 5) float32 for a sheet of hair: coordinates of the strands, two across them
            and one along them, in widths and lengths of a strand; share of the sheet that strands
            cover; depth, mm, down to which they lie below it, or minus the height of a halo of
            stray hairs. None: a closed surface.
        folds: (V, 8) float32 for cloth: places among its folds, in distances between them along
            three axes, and height, mm; for folds that hang and for creases. None: no folds.
    """

    vertices_mm: Floats
    faces: Triangles
    albedo: Floats | None = None
    occluder: Triangles | None = None
    two_sided: bool = False
    strands: Floats | None = None
    folds: Floats | None = None

    def __post_init__(self) -> None:
        """Check shapes and sizes of the arrays. Raises MeshError if they cannot be rendered."""
        if self.vertices_mm.ndim != 2 or self.vertices_mm.shape[1] != 3:
            raise MeshError(f"vertices must be (V, 3), not {self.vertices_mm.shape}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise MeshError(f"faces must be (F, 3), not {self.faces.shape}")
        if len(self.vertices_mm) == 0 or len(self.faces) == 0:
            raise MeshError(
                f"the mesh has {len(self.vertices_mm)} vertices and {len(self.faces)} triangles: "
                "there is nothing to render"
            )
        if self.albedo is not None and self.albedo.shape != (len(self.vertices_mm),):
            raise MeshError(
                f"albedo must be one number per vertex ({len(self.vertices_mm)}), "
                f"not {self.albedo.shape}"
            )


def vertex_normals(points: Reals, triangles: NDArray[np.integer]) -> Array:
    """Compute (N, 3) unit normals as area-weighted means over triangles; 0 without triangles."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    facing = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    corners = triangles.ravel()
    summed = np.stack([np.bincount(corners, facing[:, k], len(points)) for k in range(3)], axis=1)
    return np.asarray(summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-9))


def reduced(
    vertices_mm: Reals,
    faces: NDArray[np.integer],
    share: float,
    named: NDArray[np.integer] | None = None,
) -> tuple[Floats, Triangles, Triangles]:
    """Reduce a mesh to a share of its triangles.

    Edges are collapsed by the smallest quadric error (Garland and Heckbert 1997).

    Args:
        vertices_mm, faces: the vertices (V, 3) and triangles (F, 3) of the mesh.
        share: share of the triangles that the result has, 0 to 1.
        named: indices of vertices that other data refer to, such as landmarks.

    Returns:
        The new vertices, (V', 3) mm; the new triangles, (F', 3); and for each new vertex the index
        of an old vertex that was merged into it, (V',): a named one, or else the nearest.
    """
    import fast_simplification

    # The arrays are copied, because the library refuses read-only arrays.
    points, triangles = np.array(vertices_mm, np.float32), np.array(faces, np.int32)
    count = int(share * len(triangles))
    with _SIMPLIFYING:
        *_, collapses = fast_simplification.simplify(
            points, triangles, target_count=count, agg=_AGGRESSIVENESS, return_collapses=True
        )
        replayed = fast_simplification.replay_simplification(points, triangles, collapses)
    places, left, became = replayed
    distance = np.linalg.norm(points - places[became], axis=1)
    farthest_first = np.argsort(-distance, kind="stable")
    nearest = np.empty(len(places), dtype=np.int32)
    nearest[became[farthest_first]] = farthest_first  # the last write, of the nearest vertex, stays
    if named is not None:
        nearest[became[named]] = named
    return places, left, nearest


def occluder_of(vertices_mm: Reals, faces: NDArray[np.integer]) -> Triangles:
    """Reduce a mesh's triangles to ``KEPT_SHARE`` of them, for shadows: (F', 3) int32 indices.

    A shadow needs less detail than an image, and the time to render a shadow map grows with the
    number of triangles. The occluder uses the mesh's own vertices. A face model therefore has one
    occluder for all its shapes, made from its mean shape ``vertices_mm``.
    """
    _, left, nearest = reduced(vertices_mm, faces, KEPT_SHARE)
    occluder: Triangles = nearest[left]
    occluder.setflags(write=False)
    return occluder
