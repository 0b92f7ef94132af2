"""Select, order and label the triangles of ICT-FaceKit, with an albedo per region.

Regions come from the ``usemtl`` groups of the neutral mesh, connected components within them and
the landmarks of vertex_indices.json; this file contains no vertex numbers. The size of each part of
the face around its landmarks is chosen to cover the same area as the part of this name in
procedural faces (``tools/heads/regions.py``).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.meshes.obj import ObjFile

_Array = NDArray[np.float64]
_Ints = NDArray[np.int64]

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

#: Parts of the face mesh; a later one overrides an earlier one, the rest is "face".
FACE_PARTS: Final = ("forehead", "cheek", "chin", "lids", "nose", "brow", "lips")

_IRIS_RADIUS_CM: Final = 0.59  # the visible iris of an adult is 11.7 to 11.8 mm wide
_BROW_HALF_HEIGHT_CM: Final = 0.35  # a brow is about 7 mm high
_LIDS_WIDTH_RATIO: Final = 1.3  # width of the lids over width of the eye
_LIDS_ASPECT_RATIO: Final = 1.25  # width over height of the lids
_CHEEK_BELOW_EYES_CM: Final = 1.1  # from the level of the eyes to the upper end of the cheek
_CHEEK_FROM_MIDLINE_CM: Final = 2.2
_CHIN_HALF_WIDTH_CM: Final = 2.4
_CHIN_BELOW_LIPS_CM: Final = 0.6
_NOSE_WIDTH_RATIO: Final = 1.4  # half width of the nose over that of its base (landmark 35)
_MATERIALS: Final = {
    "M_BackHead": "head",  # and the sockets, which are separated below
    "M_GumsTongue": "gums",
    "M_Teeth": "teeth",
    "M_ScleraLeft": "sclera",
    "M_ScleraRight": "sclera",
    "M_Face": "face",  # last: vertices on a seam belong to the face
}
_IRIS_OF: Final = {"M_ScleraLeft": "M_IrisLeft", "M_ScleraRight": "M_IrisRight"}


def label_triangles(
    neutral: ObjFile, landmarks: _Ints
) -> tuple[NDArray[np.int32], _Ints, NDArray[np.uint8]]:
    """Select, label and order the triangles. Raises MeshError.

    Left out: lacrimal fluid, eye blend, eye occlusion, lashes (flat cards), and the iris meshes.
    The iris meshes lie about 1.5 mm behind the cornea, which is part of the sclera meshes and
    opaque here: the cornea in front of the iris is labelled "iris" instead.

    Args:
        landmarks: (68,) vertex indices of the Multi-PIE points.

    Returns:
        (F, 3) triangles of the kept vertices, (V,) their indices in the OBJ files, and (V,) their
        regions, indices into REGION_NAMES.
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
    for name, inside in _face_parts(neutral.vertices, neutral.vertices[landmarks]).items():
        region[face & inside] = REGION_NAMES.index(name)
    drawn = triangles[np.isin(material, [number[name] for name in _MATERIALS])]
    faces, kept = _in_drawing_order(neutral.vertices, drawn)
    return faces, kept, region[kept].astype(np.uint8)


def _label_sockets(vertices: _Array, back: _Ints, region: _Ints) -> None:
    """Label mouth and eye sockets, which are separate components of the back of the head.

    Args:
        vertices: (V, 3) cm.
        back: (T, 3) triangles.
        region: (V,) labels, changed in place.
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


def _connected_components(count: int, triangles: _Ints) -> _Ints:
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
    vertices: _Array,
    white: _Ints,
    iris: _Array,
    region: _Ints,
) -> None:
    """Label the part of the eyeball within the iris' radius around the visual axis.

    Args:
        white: vertex indices of the sclera mesh.
        iris: (N, 3) vertices of the iris mesh, cm.
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
    region[white[(along > 0) & (beside < _IRIS_RADIUS_CM)]] = REGION_NAMES.index("iris")


def _in_drawing_order(vertices: _Array, triangles: _Ints) -> tuple[NDArray[np.int32], _Ints]:
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


def _face_parts(points: _Array, landmarks: _Array) -> dict[str, NDArray[np.bool_]]:
    """Return part -> (V,) whether each point belongs to it; parts overlap.

    Args:
        points: (V, 3) centimetres, +x the subject's left, +y up.
        landmarks: (68, 3).
    """
    x, y, side = points[:, 0], points[:, 1], np.abs(points[:, 0])
    eyes = (landmarks[36:42], landmarks[42:48])
    brows = (landmarks[17:22], landmarks[22:27])
    eye_level = float(np.mean([eye[:, 1].mean() for eye in eyes]))
    brow_level = float(np.mean([brow[:, 1].mean() for brow in brows]))
    jaw = landmarks[:17][np.argsort(landmarks[:17, 0])]
    above_jaw = y > np.interp(x, jaw[:, 0], jaw[:, 1])
    lower_lip = float(landmarks[57, 1])
    inner = float(np.abs(landmarks[[39, 42], 0]).mean())
    wing = _NOSE_WIDTH_RATIO * float(np.abs(landmarks[[31, 35], 0]).mean())
    heights = landmarks[[33, 30, 28, 27], 1]  # base, tip, bridge, root: upwards
    nose_half = np.interp(y, heights, (wing, wing, inner / 2, inner / 2), left=0.0, right=0.0)
    lids, brow = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for eye in eyes:
        centre, half = eye.mean(axis=0), np.ptp(eye[:, 0]) / 2
        lids |= (
            np.hypot(x - centre[0], (y - centre[1]) * _LIDS_ASPECT_RATIO) < _LIDS_WIDTH_RATIO * half
        )
    for line in brows:
        arch = np.interp(x, line[:, 0], line[:, 1], left=np.inf, right=np.inf)
        brow |= np.abs(y - arch) < _BROW_HALF_HEIGHT_CM
    return {
        "forehead": y > brow_level,
        "cheek": above_jaw
        & (y < eye_level - _CHEEK_BELOW_EYES_CM)
        & (side > _CHEEK_FROM_MIDLINE_CM),
        "chin": above_jaw & (y < lower_lip - _CHIN_BELOW_LIPS_CM) & (side < _CHIN_HALF_WIDTH_CM),
        "lids": lids,
        "nose": side < nose_half,
        "brow": brow,
        "lips": _inside(x, y, landmarks[48:60, :2]),
    }


def _inside(x: _Array, y: _Array, outline: _Array) -> NDArray[np.bool_]:
    """Return (V,) whether a polygon (K, 2) encloses each point (even-odd rule)."""
    inside = np.zeros(len(x), dtype=bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > y) != (y1 > y)
            inside ^= crosses & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return inside
