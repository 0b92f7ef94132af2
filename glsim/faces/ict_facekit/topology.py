"""Select, order and label the triangles of ICT-FaceKit, with an albedo per region.

Regions come from the ``usemtl`` groups of the neutral mesh, connected components within them and
the landmarks of vertex_indices.json; this file contains no vertex numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError
from glsim.faces.ict_facekit.regions import face_parts
from glsim.meshio.obj import ObjFile

ALBEDO: Final = {
    # Diffuse, 860 nm, relative to a white wall: design notes on the sensor, section 4
    # (skin 0.4-0.68, sclera 0.4-0.6, iris dark, lips about skin).
    "face": 0.6,
    "lips": 0.55,
    "head": 0.6,
    "eye socket": 0.5,  # wet mucosa under the lids; hardly visible
    "mouth socket": 0.4,  # wet mucosa: blood-rich, like the gums
    "gums": 0.4,
    "teeth": 0.5,  # enamel is bright, but translucent and shaded by the mouth
    "sclera": 0.5,
    "iris": 0.1,
    # parts of the face, with the albedo of skin: the model has no hair
    "forehead": 0.6,
    "cheek": 0.6,
    "chin": 0.6,
    "lids": 0.6,
    "nose": 0.6,
    "brow": 0.6,
}
REGION_NAMES: Final = tuple(ALBEDO)

IRIS_RADIUS_CM: Final = 0.59  # the visible iris of an adult is 11.7 to 11.8 mm wide
_MATERIALS: Final = {
    "M_BackHead": "head",  # and the sockets, which are separated below
    "M_GumsTongue": "gums",
    "M_Teeth": "teeth",
    "M_ScleraLeft": "sclera",
    "M_ScleraRight": "sclera",
    "M_Face": "face",  # last: vertices on a seam belong to the face
}
_IRIS_OF: Final = {"M_ScleraLeft": "M_IrisLeft", "M_ScleraRight": "M_IrisRight"}


@dataclass(frozen=True, eq=False)
class Topology:
    """Triangles and vertex labels shared by all faces of the model.

    Args:
        faces: (F, 3) int32 into the kept vertices.
        kept: (V,) int64, their indices in the OBJ files.
        region: (V,) uint8 into REGION_NAMES.
    """

    faces: NDArray[np.int32]
    kept: NDArray[np.int64]
    region: NDArray[np.uint8]

    def albedo(self) -> NDArray[np.float32]:
        """Return (V,) float32 albedo by region."""
        return np.array([ALBEDO[name] for name in REGION_NAMES], dtype=np.float32)[self.region]


def build_topology(neutral: ObjFile, landmarks: NDArray[np.int64]) -> Topology:
    """Select, label and order the triangles. Raises MeshError.

    Left out: lacrimal fluid, eye blend, eye occlusion, lashes (flat cards), and the iris meshes.
    The iris meshes lie about 1.5 mm behind the cornea, which is part of the sclera meshes and
    opaque here: the cornea in front of the iris is labelled "iris" instead.

    Args:
        landmarks: (68,) vertex indices of the Multi-PIE points.
    """
    triangles, polygon = neutral.triangles()
    material = neutral.materials[polygon]
    number = {name: index for index, name in enumerate(neutral.material_names)}
    missing = [name for name in [*_MATERIALS, *_IRIS_OF.values()] if name not in number]
    if missing:
        raise MeshError(f"has no material group {missing[0]!r}: this is another model")
    region = np.full(len(neutral.vertices), -1, dtype=np.int64)
    for name, label in _MATERIALS.items():
        region[triangles[material == number[name]]] = REGION_NAMES.index(label)
    back = triangles[material == number["M_BackHead"]]
    _label_sockets(neutral.vertices, back, region)
    for sclera, iris in _IRIS_OF.items():
        white = np.unique(triangles[material == number[sclera]])
        axis_points = neutral.vertices[np.unique(triangles[material == number[iris]])]
        _label_iris(neutral.vertices, white, axis_points, region)
    face = region == REGION_NAMES.index("face")
    for name, inside in face_parts(neutral.vertices, neutral.vertices[landmarks]).items():
        region[face & inside] = REGION_NAMES.index(name)
    drawn = triangles[np.isin(material, [number[name] for name in _MATERIALS])]
    faces, kept = _in_drawing_order(neutral.vertices, drawn)
    return Topology(faces, kept, region[kept].astype(np.uint8))


def _label_sockets(
    vertices: NDArray[np.float64], back: NDArray[np.int64], region: NDArray[np.int64]
) -> None:
    """Label mouth and eye sockets, which are separate components of the back of the head.

    vertices: (V, 3) cm. back: (T, 3) triangles. region: (V,) labels, changed in place.
    """
    component = _connected_components(len(vertices), back)
    is_head = np.zeros(len(vertices), dtype=bool)
    is_head[back] = True
    is_head &= region == REGION_NAMES.index("head")
    labels, sizes = np.unique(component[is_head], return_counts=True)
    span = [
        float(np.ptp(vertices[is_head & (component == label)], axis=0).max()) for label in labels
    ]
    head = labels[int(np.argmax(span))]
    for label in labels[sizes > 0]:
        if label != head:
            in_socket = is_head & (component == label)
            offset_cm = abs(float(vertices[in_socket, 0].mean()))  # eyes: 3 cm off the midline
            name = "mouth socket" if offset_cm < 0.5 else "eye socket"
            region[in_socket] = REGION_NAMES.index(name)


def _connected_components(count: int, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (count,) the lowest index among the vertices connected to each vertex."""
    label = np.arange(count)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    while True:
        low = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
        before = label.copy()
        np.minimum.at(label, edges.ravel(), np.repeat(low, 2))
        label = label[label]  # pointer jumping: long strips converge in a few rounds
        if np.array_equal(label, before):
            return label


def _label_iris(
    vertices: NDArray[np.float64],
    white: NDArray[np.int64],
    iris: NDArray[np.float64],
    region: NDArray[np.int64],
) -> None:
    """Label the part of the eyeball within the iris' radius around the visual axis.

    white: vertex indices of the sclera mesh. iris: (N, 3) vertices of the iris mesh, cm.
    region: (V,) labels, changed in place.
    """
    points = vertices[white]
    system = np.column_stack([2 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    centre = solution[:3]  # of the least-squares sphere
    axis = iris.mean(axis=0) - centre  # the iris mesh is densest, and symmetric, about the axis
    axis /= np.linalg.norm(axis)
    along = (points - centre) @ axis
    beside = np.linalg.norm(points - centre - along[:, None] * axis, axis=1)
    region[white[(along > 0) & (beside < IRIS_RADIUS_CM)]] = REGION_NAMES.index("iris")


def _in_drawing_order(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Sort triangles along a Z-curve and vertices by first use, for cache locality.

    Returns (F, 3) faces into the used vertices, and (V,) their indices.
    """
    middle = vertices[triangles].mean(axis=1)
    cell = (middle - middle.min(axis=0)) / np.ptp(middle, axis=0).max() * 1023
    key = np.zeros(len(triangles), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            key |= (cell[:, axis].astype(np.int64) >> bit & 1) << (3 * bit + axis)
    ordered = triangles[np.argsort(key, kind="stable")]
    used, first, inverse = np.unique(ordered, return_index=True, return_inverse=True)
    by_use = np.argsort(first)
    rank = np.empty(len(used), dtype=np.int32)
    rank[by_use] = np.arange(len(used), dtype=np.int32)
    return rank[inverse].reshape(-1, 3), used[by_use]
