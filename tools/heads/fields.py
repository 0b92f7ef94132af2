"""Displacement fields on the template, and the rigid parts that follow them.

A field is a function of FieldPoints that returns a displacement (N, 3) in mm. Eyeballs with their
lids, and ears, must move rigidly: FieldPoints contains an anchor point for each of them, and
``RigidParts.apply`` replaces the displacement of a part by that of its anchor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from glsim.core.mesh import vertex_normals
from tools.heads import mouth
from tools.heads.ears import EAR_ROOT
from tools.heads.falloff import Array, Vec3, smoothstep
from tools.heads.template import (
    PART_EAR,
    PART_EYE_LINING,
    PART_EYEBALL,
    PART_MOUTH_LINING,
    PART_TEETH,
    Template,
)
from tools.heads.topology import SLIT_MOUTH
from tools.heads.volumes import EYE_CENTER

RIGID_EYE_MM = (15.0, 27.0)  # distance from an eye's centre: rigid within, free beyond
MIDLINE_MM = 4.0  # rounds |x| in Gaussians of both sides
ANCHORS = 4  # the last points of FieldPoints: left and right eye, left and right ear


@dataclass(frozen=True, eq=False)
class FieldPoints:
    """The template's points and the four anchors (N = V + 4).

    Args:
        points: (N, 3) mm.
        normals: (N, 3) unit, outwards.
        x: (N,) distance from the midline, mm.
        y, z: (N,) mm.
        side: (N,) +1 left, -1 right, 0 on the midline, smooth over 3 mm.
        upper: (N,) 1 above the mouth's line, 0 below, with a step between the lips, smooth beyond
            them.
    """

    points: Array
    normals: Array
    x: Array
    y: Array
    z: Array
    side: Array
    upper: Array

    def gaussian(self, center: Vec3, radii: Vec3) -> Array:
        """Return Gaussian weights (N,): exp(-d^2), d = 1 at ``radii``; on both sides.

        Where the two sides meet, their sum has no edge: the distance from the midline is rounded.
        """
        x = np.hypot(self.x, MIDLINE_MM) if center[0] > 0 else self.x
        d = (np.stack([x, self.y, self.z], axis=1) - np.asarray(center)) / np.asarray(radii)
        return np.asarray(np.exp(-np.einsum("ij,ij->i", d, d)))

    def displacement(self, x: Array | float, y: Array | float, z: Array | float) -> Array:
        """Return a displacement (N, 3), mm; ``x`` points away from the midline."""
        zero = np.zeros_like(self.x)
        return np.stack([self.side * x + zero, zero + y, zero + z], axis=1)


Field = Callable[[FieldPoints], Array]


def widen(p: FieldPoints, half_width: float, weight: Array) -> Array:
    """Widen by 1 mm in total (0.5 per side) at x = ``half_width`` and weight 1."""
    return p.displacement(0.5 * p.x / half_width * weight, 0.0, 0.0)


def front_weight(p: FieldPoints) -> Array:
    """Return (N,) weights: 1 on the face, 0 behind the ears."""
    return smoothstep(-95.0, -45.0, p.z)


def upper_weight(template: Template) -> Array:
    """Return (V,) weights: 1 above the mouth's line, 0 below it.

    Between the corners the weights open the lips as an ellipse: along the slit 0.5...1 on the upper
    lip, 0.5...0 on the lower. Beyond the corners the transition widens with distance.
    """
    x, y = np.abs(template.points[:, 0]), template.points[:, 1]
    above = y - mouth.stomion_line(np.minimum(x, mouth.CORNER_X))
    inside = np.isin(template.part, (PART_MOUTH_LINING, PART_TEETH))
    above = np.where((template.slit == SLIT_MOUTH) | inside, 0.0, above)
    # the opening is an ellipse at the lips, wider inside, where the jaw carries the whole floor
    deep = smoothstep(1.0, 5.0, template.ring * (template.slit == SLIT_MOUTH).astype(np.float64))
    lips = 0.5 * np.clip(1.0 - (x / mouth.CORNER_X) ** (2.3 + 3.7 * deep), 0.0, 1.0) ** 0.5
    spread = (
        6.0 + 1.0 * np.maximum(x - 16.0, 0.0) + 0.35 * np.maximum(0, 10 - template.points[:, 2])
    )
    distance = 0.5 * smoothstep(0.0, 1.0, np.abs(above) / spread)
    amount = np.maximum(distance, lips + (0.5 - lips) * 2 * distance)
    amount = np.where(template.part == PART_TEETH, 0.5, amount)
    is_low = np.where((template.slit == SLIT_MOUTH) | inside, template.low, above < 0)
    return np.asarray(np.where(is_low, 0.5 - amount, 0.5 + amount))


def make_field_points(template: Template) -> FieldPoints:
    """Return the points of the template, followed by the anchors."""
    anchors = np.array(
        [np.array(p) * (s, 1, 1) for p in (EYE_CENTER, EAR_ROOT) for s in (1.0, -1.0)]
    )
    points = np.concatenate([template.points, anchors])
    normals = np.concatenate(
        [vertex_normals(template.points, template.faces), np.tile([0.0, 0.0, 1.0], (ANCHORS, 1))]
    )
    return FieldPoints(
        points=points,
        normals=normals,
        x=np.abs(points[:, 0]),
        y=points[:, 1],
        z=points[:, 2],
        side=np.clip(points[:, 0] / 1.5, -1.0, 1.0),
        upper=np.concatenate([upper_weight(template), np.ones(ANCHORS)]),
    )


@dataclass(frozen=True, eq=False)
class RigidParts:
    """Weights (V,) of the anchors at each vertex, for the left and right eye and ear."""

    eyes: tuple[Array, Array]
    ears: tuple[Array, Array]

    def apply(self, field: Array) -> Array:
        """Return the field (V, 3) with rigid parts, from a field with anchors (V + 4, 3)."""
        body, anchors = field[:-ANCHORS], field[-ANCHORS:]
        for weight, anchor in zip((*self.eyes, *self.ears), anchors, strict=True):
            body = body + weight[:, None] * (anchor - body)
        return np.asarray(body)


def make_rigid_parts(template: Template) -> RigidParts:
    """Return the rigid parts of the template."""
    left = template.points[:, 0] > 0
    eyes = []
    for side in (1.0, -1.0):
        away = template.points - np.array(EYE_CENTER) * (side, 1, 1)
        weight = smoothstep(RIGID_EYE_MM[1], RIGID_EYE_MM[0], np.linalg.norm(away, axis=1))
        piece = np.isin(template.part, (PART_EYEBALL, PART_EYE_LINING)) & (left == (side > 0))
        eyes.append(np.where(piece, 1.0, weight))
    ear = template.part == PART_EAR
    return RigidParts((eyes[0], eyes[1]), (1.0 * (ear & left), 1.0 * (ear & ~left)))
