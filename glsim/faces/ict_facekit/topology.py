"""Which of the ICT-FaceKit triangles are drawn, in what order, and how bright they are.

Regions come from the ``usemtl`` groups of the neutral mesh, connected parts within them and the
landmarks of vertex_indices.json: no vertex number is written down here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError
from glsim.faces.ict_facekit.regions import face_parts
from glsim.objfile import ObjFile

ALBEDO: Final = {
    # Diffuse, 860 nm, relative to a white wall: design notes on the sensor, section 4
    # (skin 0.4-0.68, sclera 0.4-0.6, iris dark, lips about skin).
    "face": 0.6,
    "lips": 0.55,
    "head": 0.6,
    "eye socket": 0.5,  # wet mucosa under the lids; hardly seen
    "mouth socket": 0.4,  # wet mucosa: blood-rich, as the gums
    "gums": 0.4,
    "teeth": 0.5,  # enamel is bright, but translucent and in the mouth's shade
    "sclera": 0.5,
    "iris": 0.1,
    # parts of the face, as bright as the rest of it: the model has no hair
    "forehead": 0.6,
    "cheek": 0.6,
    "chin": 0.6,
    "lids": 0.6,
    "nose": 0.6,
    "brow": 0.6,
}
REGION_NAMES: Final = tuple(ALBEDO)

IRIS_RADIUS: Final = 0.59  # cm; the visible iris of an adult is 11.7 to 11.8 mm wide
_MATERIALS: Final = {
    "M_BackHead": "head",  # and the sockets, told apart below
    "M_GumsTongue": "gums",
    "M_Teeth": "teeth",
    "M_ScleraLeft": "sclera",
    "M_ScleraRight": "sclera",
    "M_Face": "face",  # last: vertices on a seam belong to the face
}
_IRIS_OF: Final = {"M_ScleraLeft": "M_IrisLeft", "M_ScleraRight": "M_IrisRight"}


@dataclass(frozen=True, eq=False)
class Topology:
    """What all faces of the model share.

    faces: (F, 3) int32 into the kept vertices. kept: (V,) int64, their numbers in the model.
    region: (V,) uint8 into REGION_NAMES.
    """

    faces: NDArray[np.int32]
    kept: NDArray[np.int64]
    region: NDArray[np.uint8]

    def albedo(self) -> NDArray[np.float32]:
        """(V,) float32, from the region."""
        return np.array([ALBEDO[name] for name in REGION_NAMES], dtype=np.float32)[self.region]


def build_topology(neutral: ObjFile, landmarks: NDArray[np.int64]) -> Topology:
    """Pick, label and order. landmarks: (68,) Multi-PIE points. Raises MeshError.

    Left out: lacrimal fluid, eye blend, eye occlusion, lashes (flat cards), and the iris meshes.
    Those lie some 1.5 mm behind the cornea, which the sclera meshes include and which nothing
    here sees through: the cornea in front of the iris is labelled "iris" instead.
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
    for name, where in face_parts(neutral.vertices, neutral.vertices[landmarks]).items():
        region[face & where] = REGION_NAMES.index(name)
    drawn = triangles[np.isin(material, [number[name] for name in _MATERIALS])]
    faces, kept = _in_drawing_order(neutral.vertices, drawn)
    return Topology(faces, kept, region[kept].astype(np.uint8))


def _label_sockets(
    vertices: NDArray[np.float64], back: NDArray[np.int64], region: NDArray[np.int64]
) -> None:
    """The back of the head, mouth and eyes hang together through the face only."""
    part = _connected(len(vertices), back)
    mine = np.zeros(len(vertices), dtype=bool)
    mine[back] = True
    mine &= region == REGION_NAMES.index("head")
    labels, sizes = np.unique(part[mine], return_counts=True)
    span = [float(np.ptp(vertices[mine & (part == label)], axis=0).max()) for label in labels]
    head = labels[int(np.argmax(span))]
    for label in labels[sizes > 0]:
        if label != head:
            here = mine & (part == label)
            middle = abs(float(vertices[here, 0].mean())) < 0.5  # cm; eyes are 3 cm off the middle
            region[here] = REGION_NAMES.index("mouth socket" if middle else "eye socket")


def _connected(count: int, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) the lowest vertex number each vertex is connected to by triangles."""
    label = np.arange(count)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    while True:
        low = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
        before = label.copy()
        np.minimum.at(label, edges.ravel(), np.repeat(low, 2))
        label = label[label]  # jump: long strips settle in a few rounds
        if np.array_equal(label, before):
            return label


def _label_iris(
    vertices: NDArray[np.float64],
    white: NDArray[np.int64],
    iris: NDArray[np.float64],
    region: NDArray[np.int64],
) -> None:
    """Label the part of the eyeball within the iris' radius of the visual axis."""
    points = vertices[white]
    system = np.column_stack([2 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    centre = solution[:3]  # of the least-squares sphere
    axis = iris.mean(axis=0) - centre  # the iris mesh is densest, and symmetric, about the axis
    axis /= np.linalg.norm(axis)
    along = (points - centre) @ axis
    beside = np.linalg.norm(points - centre - along[:, None] * axis, axis=1)
    region[white[(along > 0) & (beside < IRIS_RADIUS)]] = REGION_NAMES.index("iris")


def _in_drawing_order(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Triangles along a Z-curve, vertices numbered by first use: neighbours stay in the cache."""
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
