"""Choose the faces of the base mesh that are drawn, and divide the large ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.files import BaseMesh
from glsim.faces.people.membrane import membrane
from glsim.faces.people.subdivision import LinearMap, subdivide

#: The body, and from the helper geometry what a camera can see of a person.
GROUPS: Final = (
    "body", "helper-l-eye", "helper-r-eye", "helper-upper-teeth", "helper-lower-teeth",
    "helper-tongue",
)  # fmt: skip
_EYES: Final = ("helper-l-eye", "helper-r-eye")
#: Quads with longer mean edges are divided, mm: those of the face, of the rest of the head and
#: neck, of the body, of legs, which are seen from afar, and of eyes. Chosen so that the head's mean
#: edge is below 3.5 mm and the facets of a torso at 1 m are about 3 pixels of a Kinect wide. Hands,
#: feet and teeth are fine enough as they are.
_FACE_MM: Final = 3.4
_SCALP_MM: Final = 7.0
_BODY_MM: Final = 14.0
_LEG_MM: Final = 28.0
_EYE_MM: Final = 2.4
_STEPS: Final = 3


def drawn_quads(base: BaseMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the (Q, 4) quads that are drawn, and (Q,) the number of their group."""
    quads = []
    for name in GROUPS:
        group = base.groups[name]
        if name in _EYES:  # the back of an eyeball is never seen
            points = base.vertices_mm[group]
            front = points[..., 2].mean(axis=1) > points[..., 2].mean()
            group = group[front]
        quads.append(group)
    part = np.repeat(np.arange(len(GROUPS)), [len(group) for group in quads])
    return np.concatenate(quads), part


def refine(
    quads: NDArray[np.int64],
    part: NDArray[np.int64],
    coarse: NDArray[np.float64],
    head: NDArray[np.float64],
    weights: NDArray[np.float64],
    bones: Sequence[str],
    inside: NDArray[np.bool_],
    bare: NDArray[np.bool_],
) -> tuple[LinearMap, NDArray[np.int64]]:
    """Divide large quads, but none at the vertices ``inside`` the mouth; smooth ``bare`` ones.

    Returns the map to the fine vertices and the (F, 3) triangles.
    """
    limit = _length_limits(coarse, head, weights, bones, quads, part)
    limit[inside] = np.inf
    whole = membrane(quads, bare)
    triangles: list[NDArray[np.int64]] = []
    fixed = np.zeros(len(coarse), dtype=bool)
    for _ in range(_STEPS):
        points = whole.apply(coarse)
        corners = points[quads]
        length = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).mean(axis=1)
        held = fixed[quads]
        marked = (length > whole.apply(limit)[quads].mean(axis=1)) & ~(
            held & np.roll(held, -1, axis=1)
        ).any(axis=1)
        step = subdivide(quads, marked, fixed)
        whole, quads = step.map.after(whole), step.quads
        triangles.append(step.triangles)
        fixed = np.zeros(step.map.height, dtype=bool)
        for fan in triangles:
            fixed[fan.ravel()] = True
    return whole, np.concatenate([*triangles, _triangles(quads, whole.apply(coarse))])


def _length_limits(
    coarse: NDArray[np.float64],
    head: NDArray[np.float64],
    weights: NDArray[np.float64],
    bones: Sequence[str],
    quads: NDArray[np.int64],
    part: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return (P,) the mean edge above which quads at each coarse vertex are divided, mm."""
    limit = np.full(len(coarse), _BODY_MM)
    neck = weights[:, [n for n, name in enumerate(bones) if name.startswith("neck")]]
    limit[neck.sum(axis=1) > 0.3] = _SCALP_MM
    limit[head > 0.5] = _SCALP_MM
    ear_z = coarse[head > 0.5, 2].mean()
    limit[(head > 0.5) & (coarse[:, 2] > ear_z)] = _FACE_MM
    extremities = [n for n, name in enumerate(bones) if name.startswith(("finger", "foot", "toe"))]
    limit[weights[:, extremities].sum(axis=1) > 0.5] = np.inf
    legs = [n for n, name in enumerate(bones) if "leg" in name]
    limit[weights[:, legs].sum(axis=1) > 0.5] = _LEG_MM
    for number, name in enumerate(GROUPS):
        inside = np.unique(quads[part == number])
        if name in _EYES:
            limit[inside] = _EYE_MM
        elif name != "body":
            limit[inside] = np.inf
    return limit


def _triangles(quads: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Split quads along their shorter diagonal."""
    a, b, c, d = points[quads].transpose(1, 0, 2)
    first = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
    turned = np.where(first[:, None], quads, np.roll(quads, -1, axis=1))
    return np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
