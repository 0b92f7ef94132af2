"""Displacement fields on the template: the points they see, and how parts follow them.

A field is a function of a Canvas that gives a displacement (N, 3) in mm. Eyeballs with their lids,
and ears, must move as rigid pieces: the canvas carries an anchor point for each of them, and
``settle`` replaces the displacement of the piece by that of its anchor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural import mouth
from glsim.faces.procedural.ears import EAR_ROOT
from glsim.faces.procedural.sculpt import Array, Vec3, smoothstep
from glsim.faces.procedural.template import (
    PART_EAR,
    PART_EYE_LINING,
    PART_EYEBALL,
    PART_MOUTH_LINING,
    PART_TEETH,
    Template,
)
from glsim.faces.procedural.topology import SLIT_MOUTH
from glsim.faces.procedural.volumes import EYE_CENTER

RIGID_EYE_MM = (15.0, 27.0)  # round an eye's centre: wholly rigid within, wholly free beyond
ANCHORS = 4  # the last points of a canvas: left and right eye, left and right ear


@dataclass(frozen=True, eq=False)
class Canvas:
    """The template's points and the four anchors (N = V + 4).

    points: (N, 3) mm. normals: (N, 3) unit, outwards. x: (N,) distance from the midline.
    side: (N,) +1 left, -1 right, 0 on the midline, smooth across 3 mm.
    upper: (N,) 1 above the mouth's line, 0 below, jumping between the lips, smooth beyond them.
    """

    points: Array
    normals: Array
    x: Array
    y: Array
    z: Array
    side: Array
    upper: Array

    def near(self, center: Vec3, radii: Vec3) -> Array:
        """A soft ellipsoid (N,): exp(-d^2), d = 1 at ``radii``; on both sides of the face."""
        d = (np.stack([self.x, self.y, self.z], axis=1) - np.asarray(center)) / np.asarray(radii)
        return np.asarray(np.exp(-np.einsum("ij,ij->i", d, d)))

    def vector(self, x: Array | float, y: Array | float, z: Array | float) -> Array:
        """A displacement (N, 3); ``x`` points away from the midline."""
        zero = np.zeros_like(self.x)
        return np.stack([self.side * x + zero, zero + y, zero + z], axis=1)


Field = Callable[[Canvas], Array]


def widen(c: Canvas, half_width: float, weight: Array) -> Array:
    """Widens by 1 mm in all (0.5 a side) where x is ``half_width`` and the weight is 1."""
    return c.vector(0.5 * c.x / half_width * weight, 0.0, 0.0)


def front_share(c: Canvas) -> Array:
    """(N,) 1 on the face, 0 behind the ears."""
    return smoothstep(-95.0, -45.0, c.z)


def vertex_normals(points: Array, faces: NDArray[np.int32]) -> Array:
    """Unit normals (V, 3), weighted by area."""
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.stack(
        [
            sum(np.bincount(faces[:, k], normal[:, axis], len(points)) for k in range(3))
            for axis in range(3)
        ],
        axis=1,
    )
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def upper_share(template: Template) -> Array:
    """(V,) 1 above the mouth's line, 0 below it.

    Between the corners the lips part: along the slit the upper lip has 0.5...1, the lower 0.5...0,
    as in an ellipse. Beyond the corners the change spreads the wider the farther away.
    """
    x, y = np.abs(template.points[:, 0]), template.points[:, 1]
    above = y - mouth.stomion_line(np.minimum(x, mouth.CORNER_X))
    inside = np.isin(template.part, (PART_MOUTH_LINING, PART_TEETH))
    above = np.where((template.slit == SLIT_MOUTH) | inside, 0.0, above)
    lips = 0.5 * np.clip(1.0 - (x / mouth.CORNER_X) ** 2, 0.0, 1.0) ** 0.7
    spread = (
        6.0 + 1.0 * np.maximum(x - 16.0, 0.0) + 0.35 * np.maximum(0, 10 - template.points[:, 2])
    )
    distance = 0.5 * smoothstep(0.0, 1.0, np.abs(above) / spread)
    amount = np.maximum(distance, lips + (0.5 - lips) * 2 * distance)
    amount = np.where(template.part == PART_TEETH, 0.5, amount)
    is_low = np.where((template.slit == SLIT_MOUTH) | inside, template.low, above < 0)
    return np.asarray(np.where(is_low, 0.5 - amount, 0.5 + amount))


def make_canvas(template: Template) -> Canvas:
    """The canvas of the template, its anchors last."""
    anchors = np.array(
        [np.array(p) * (s, 1, 1) for p in (EYE_CENTER, EAR_ROOT) for s in (1.0, -1.0)]
    )
    points = np.concatenate([template.points, anchors])
    normals = np.concatenate(
        [vertex_normals(template.points, template.faces), np.tile([0.0, 0.0, 1.0], (ANCHORS, 1))]
    )
    return Canvas(
        points=points,
        normals=normals,
        x=np.abs(points[:, 0]),
        y=points[:, 1],
        z=points[:, 2],
        side=np.clip(points[:, 0] / 1.5, -1.0, 1.0),
        upper=np.concatenate([upper_share(template), np.ones(ANCHORS)]),
    )


@dataclass(frozen=True, eq=False)
class Rigid:
    """Which vertices follow the anchors: weights (V,) of the left and right eye and ear."""

    eyes: tuple[Array, Array]
    ears: tuple[Array, Array]

    def settle(self, field: Array) -> Array:
        """The field (V, 3) with rigid pieces, from a raw field (V + 4, 3)."""
        body, anchors = field[:-ANCHORS], field[-ANCHORS:]
        for weight, anchor in zip((*self.eyes, *self.ears), anchors, strict=True):
            body = body + weight[:, None] * (anchor - body)
        return np.asarray(body)


def make_rigid(template: Template) -> Rigid:
    """The rigid pieces of the template."""
    left = template.points[:, 0] > 0
    eyes = []
    for side in (1.0, -1.0):
        away = template.points - np.array(EYE_CENTER) * (side, 1, 1)
        weight = smoothstep(RIGID_EYE_MM[1], RIGID_EYE_MM[0], np.linalg.norm(away, axis=1))
        piece = np.isin(template.part, (PART_EYEBALL, PART_EYE_LINING)) & (left == (side > 0))
        eyes.append(np.where(piece, 1.0, weight))
    ear = template.part == PART_EAR
    return Rigid((eyes[0], eyes[1]), (1.0 * (ear & left), 1.0 * (ear & ~left)))
