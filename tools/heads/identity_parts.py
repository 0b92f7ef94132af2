"""Identity fields of parts that move on their own: lids (on the eyeball), ears (on their hinge).

As in identity.py, a field is a displacement in mm per unit of its parameter, here (V, 3).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from glsim.faces.procedural.lids import EYE_RADIUS
from tools.heads.ears import EAR_LENGTH, EAR_ROOT
from tools.heads.falloff import Array
from tools.heads.lids import LidWeights
from tools.heads.template import PART_EAR, Template
from tools.heads.volumes import EYE_CENTER

PartField = Callable[[Template, LidWeights], Array]


def _on_globe(template: Template, lids: LidWeights, rise: Array) -> Array:
    """Return a field (V, 3) that lifts the lid vertices by ``rise`` (L,) mm along the eyeball."""
    points = template.points[lids.index]
    up = points[:, 1] - EYE_CENTER[1]
    out = np.maximum(points[:, 2] - EYE_CENTER[2], 0.6 * EYE_RADIUS)
    field = np.zeros_like(template.points)
    field[lids.index, 1] = rise
    field[lids.index, 2] = -rise * np.clip(up / out, -1.0, 1.0)
    return field


def eye_fissure_height(template: Template, lids: LidWeights) -> Array:
    """Open the lids by 1 mm, two thirds of it above."""
    arch = (4.0 * lids.share * (1.0 - lids.share)) ** 0.8
    return _on_globe(template, lids, arch * (0.65 * lids.upper - 0.35 * lids.lower))


def canthal_tilt(template: Template, lids: LidWeights) -> Array:
    """Raise the outer third of the fissure by up to 1 mm, lower the inner corner a little."""
    rise = np.interp(lids.share, (0.0, 0.25, 0.9, 1.0), (-0.3, 0.0, 1.0, 1.0))
    return _on_globe(template, lids, rise * np.maximum(lids.upper, lids.lower))


def eye_fissure_length(template: Template, lids: LidWeights) -> Array:
    """Move the outer corner out by 0.7 mm and the inner one in by 0.3 mm."""
    stretch = np.interp(lids.share, (0.0, 0.35, 1.0), (-0.3, 0.0, 0.7))
    stretch *= np.maximum(lids.upper, lids.lower)
    field = np.zeros_like(template.points)
    field[lids.index, 0] = stretch * np.where(lids.left, 1.0, -1.0)
    field[lids.index, 2] = -0.25 * np.abs(stretch)
    return field


def ear_length(template: Template, _lids: LidWeights) -> Array:
    """Scale the ear about its root, its width at half the rate."""
    ear = (template.part == PART_EAR)[:, None]
    root = np.where(template.points[:, :1] > 0, 1.0, -1.0) * np.array([EAR_ROOT[0], 0.0, 0.0])
    root = root + np.array([0.0, EAR_ROOT[1], EAR_ROOT[2]])
    away = (template.points - root) / EAR_LENGTH
    return np.asarray(ear * away * np.array([0.5, 1.0, 0.5]))


def ear_protrusion(template: Template, _lids: LidWeights) -> Array:
    """Rotate the ear about its vertical hinge by 1 degree."""
    ear = template.part == PART_EAR
    side = np.where(template.points[:, 0] > 0, 1.0, -1.0)
    x = np.abs(template.points[:, 0]) - EAR_ROOT[0]
    z = template.points[:, 2] - EAR_ROOT[2]
    turn = np.deg2rad(1.0) * ear
    return np.stack([-side * z * turn, 0 * z, x * turn], axis=1)


PART_FIELDS: Mapping[str, PartField] = {
    field.__name__: field
    for field in (eye_fissure_height, canthal_tilt, eye_fissure_length, ear_length, ear_protrusion)
}
