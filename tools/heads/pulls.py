"""Skin pulls of the action units on the template, and the weight of the jaw."""

from __future__ import annotations

import numpy as np

from tools.heads.actions import ACTION_UNITS, LOWER, UPPER, ActionUnit
from tools.heads.falloff import Array, smoothstep
from tools.heads.fields import ANCHORS, FieldPoints
from tools.heads.lids import LidWeights
from tools.heads.template import PART_EAR, PART_EYEBALL, PART_TEETH, Template

SIDE_BLEND_MM = 12.0  # one-sided units fade over this distance at the midline
SIDEWAYS_MM = 10.0  # sideways pulls fade to 0 within this distance of the midline
LID_STIFFNESS = 0.85  # the lids take 1 - this of the skin pulls around them


def jaw_weight(template: Template, field_points: FieldPoints) -> Array:
    """Return (V,) weights: 1 on the mandible, 0 on the skull and the lower neck."""
    count = len(template.points)
    y, z = field_points.y[:count], field_points.z[:count]
    weight = (1.0 - field_points.upper[:count]) * smoothstep(-115.0, -55.0, z)
    weight = weight * smoothstep(-165.0, -90.0, y)
    weight = np.where(template.part == PART_TEETH, template.low, weight)
    return np.where(np.isin(template.part, (PART_EAR, PART_EYEBALL)), 0.0, weight)


def unit_field(field_points: FieldPoints, unit: ActionUnit) -> Array:
    """Return the displacement (N, 3) in mm of a unit's pulls, on both sides."""
    field = np.zeros_like(field_points.points)
    sideways = np.clip(field_points.points[:, 0] / SIDEWAYS_MM, -1.0, 1.0)
    for pull in unit.pulls:
        weight = field_points.gaussian(pull.center, pull.radii)
        if pull.lips == UPPER:
            weight = weight * field_points.upper
        elif pull.lips == LOWER:
            weight = weight * (1.0 - field_points.upper)
        across, up, out = pull.move
        field += weight[:, None] * np.stack(
            [sideways * across, np.full_like(weight, up), np.full_like(weight, out)], axis=1
        )
    return field


def side_fields(
    template: Template, field_points: FieldPoints, lids: LidWeights
) -> dict[str, Array]:
    """Return "AU1_L", "AU1_R", "AU2_L", ... -> displacement (V, 3) in mm at full intensity."""
    free = np.where(np.isin(template.part, (PART_EAR, PART_EYEBALL, PART_TEETH)), 0.0, 1.0)
    free[lids.index] = 1.0 - LID_STIFFNESS * np.maximum(lids.upper, lids.lower)
    left = smoothstep(-SIDE_BLEND_MM, SIDE_BLEND_MM, template.points[:, 0])
    jaw = jaw_weight(template, field_points)
    fields = {}
    for unit in ACTION_UNITS:
        field = unit_field(field_points, unit)[:-ANCHORS] * free[:, None]
        field += jaw[:, None] * np.asarray(unit.jaw_slide)
        fields[f"{unit.name}_L"] = field * left[:, None]
        fields[f"{unit.name}_R"] = field * (1.0 - left)[:, None]
    return fields
