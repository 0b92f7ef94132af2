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

#: Default albedo of a mesh without one: diffuse reflectivity of skin at 860 nm relative to a white
#: wall, 0.5-0.6 (NIST reflectance data of skin, Cooksey 2017) over 0.85-0.9.
SKIN_ALBEDO = 0.6
#: Share of the triangles that is kept; chosen by the error in docs/results/speed.md.
KEPT_SHARE = 0.44

#: Growth of the library's error bound, 1 to 7 (its default): 5 is the least that reaches the share.
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
            None for SKIN_ALBEDO.
        occluder: (F', 3) int32 fewer triangles that cast the shadows (``occluder_of``), or None for
            ``faces``.
        two_sided: whether triangles are drawn from behind too. Those of files are: a file may be
            open, or wound at random.
    """

    vertices_mm: Floats
    faces: Triangles
    albedo: Floats | None = None
    occluder: Triangles | None = None
    two_sided: bool = False

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
    """Compute (N, 3) unit normals as area-weighted means over triangles; 0 without any."""
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
        vertices_mm, faces: (V, 3) and (F, 3).
        share: of the triangles that is kept, 0 to 1.
        named: vertices that others name, such as landmarks.

    Returns:
        The vertices that are left, (V', 3) mm; their triangles (F', 3); and for each of them a
        vertex (V',) of the mesh, of those that became one: a named one, or the nearest.
    """
    import fast_simplification

    # Copies, for the library refuses arrays that are read-only.
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
    nearest[became[farthest_first]] = farthest_first  # the last one written is the nearest
    if named is not None:
        nearest[became[named]] = named
    return places, left, nearest


def occluder_of(vertices_mm: Reals, faces: NDArray[np.integer]) -> Triangles:
    """Reduce a mesh's triangles for shadows to a share of ``KEPT_SHARE``: (F', 3) int32 indices.

    Emitters need no more of a head than what it hides, and the cost of a z-buffer is its triangles.
    The occluder has the mesh's own vertices: one list of triangles serves all blends of a model,
    whose mean shape is ``vertices_mm``.
    """
    _, left, nearest = reduced(vertices_mm, faces, KEPT_SHARE)
    occluder: Triangles = nearest[left]
    occluder.setflags(write=False)
    return occluder
