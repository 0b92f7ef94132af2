"""Fewer triangles that cast almost the same shadow: the occluder of a mesh.

Emitters need no more of a head than what it hides, and the cost of a z-buffer is its triangles. The
occluder has the mesh's own vertices, so that one list of triangles serves all blends of a model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Share of the triangles that is kept; chosen by the error in docs/speed.md.
KEPT_SHARE = 0.44

#: How fast the library raises its error bound, 1 to 7 (its default): 5 is the slowest that reaches
#: the share.
_AGGRESSIVENESS = 5


def occluder_of(vertices_mm: NDArray[np.floating], faces: NDArray[np.integer]) -> NDArray[np.int32]:
    """Choose fewer triangles for shadows: (F', 3) int32 vertex indices, F' = ``KEPT_SHARE`` * F.

    Edges are collapsed by the smallest quadric error (Garland and Heckbert 1997); of the vertices
    that became one, the nearest to their common place stands for them.

    Args:
        vertices_mm: (V, 3), the mean shape of the meshes that share ``faces``, (F, 3).
    """
    import fast_simplification

    # Copies, for the library refuses arrays that are read-only.
    points, triangles = np.array(vertices_mm, np.float32), np.array(faces, np.int32)
    collapses = fast_simplification.simplify(
        points,
        triangles,
        target_count=int(KEPT_SHARE * len(triangles)),
        agg=_AGGRESSIVENESS,
        return_collapses=True,
    )[2]
    places, left, became = fast_simplification.replay_simplification(points, triangles, collapses)
    distance = np.linalg.norm(points - places[became], axis=1)
    farthest_first = np.argsort(-distance, kind="stable")
    nearest = np.empty(len(places), dtype=np.int32)
    nearest[became[farthest_first]] = farthest_first  # the last one written is the nearest
    occluder: NDArray[np.int32] = nearest[left]
    occluder.setflags(write=False)
    return occluder
