"""From action unit intensities to displacements: skin pulls, sliding lids, the turning jaw.

A frame is ``neutral + coefficients @ basis``. Skin pulls are the same for all subjects; lids and
jaw depend on the subject's own geometry. Turning about the jaw's axis by t is linear in
(sin t, 1 - cos t), sliding of a lid by a is linear in (a, a^2): one matrix product does it all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, did_you_mean
from glsim.faces.procedural.actions import LOWER, UNITS, UPPER, Unit
from glsim.faces.procedural.fields import ANCHORS, Canvas
from glsim.faces.procedural.lids import Lids, closing
from glsim.faces.procedural.sculpt import Array, smoothstep
from glsim.faces.procedural.template import PART_EAR, PART_EYEBALL, PART_TEETH, Template

TMJ = (0.0, -1.0, -78.0)  # axis of the temporomandibular joint, mm; just before the tragus
JAW_LIMIT_DEG = 22.0  # about 45 mm between the incisors; normal maximum 40-55 mm
SIDE_BLEND_MM = 12.0  # a one-sided unit fades across the midline
SIDEWAYS_MM = 10.0  # sideways pulls fade to 0 at the midline over this
LID_KEEPS = 0.85  # lids follow the skin pulled round them by 1 - this
SIDES = ("L", "R")
LID_COLUMNS = 8  # (upper, lower) x (linear, square) x (left, right)
JAW_COLUMNS = 2


@dataclass(frozen=True, eq=False)
class ActionBasis:
    """The part of the basis that all subjects share.

    pulls: (2 * units, V * 3) float32 mm; rows are AU1_L, AU1_R, AU2_L... jaw: (V,) how much each
    vertex turns with the jaw.
    """

    units: tuple[Unit, ...]
    pulls: NDArray[np.float32]
    jaw: Array


def jaw_share(template: Template, canvas: Canvas) -> Array:
    """(V,) 1 on the mandible, 0 on the skull and low on the neck."""
    count = len(template.points)
    y, z = canvas.y[:count], canvas.z[:count]
    share = (1.0 - canvas.upper[:count]) * smoothstep(-115.0, -55.0, z)
    share = share * smoothstep(-165.0, -90.0, y)
    share = np.where(template.part == PART_TEETH, template.low, share)
    return np.where(np.isin(template.part, (PART_EAR, PART_EYEBALL)), 0.0, share)


def unit_field(canvas: Canvas, unit: Unit) -> Array:
    """Both sides of a unit's pulls (N, 3)."""
    field = np.zeros_like(canvas.points)
    sideways = np.clip(canvas.points[:, 0] / SIDEWAYS_MM, -1.0, 1.0)
    for pull in unit.pulls:
        weight = canvas.near(pull.center, pull.radii)
        if pull.lips == UPPER:
            weight = weight * canvas.upper
        elif pull.lips == LOWER:
            weight = weight * (1.0 - canvas.upper)
        across, up, out = pull.move
        field += weight[:, None] * np.stack(
            [sideways * across, np.full_like(weight, up), np.full_like(weight, out)], axis=1
        )
    return field


def make_action_basis(template: Template, canvas: Canvas, lids: Lids) -> ActionBasis:
    """Skin pulls of all units on the template."""
    count = len(template.points)
    free = np.where(np.isin(template.part, (PART_EAR, PART_EYEBALL, PART_TEETH)), 0.0, 1.0)
    free[lids.index] = 1.0 - LID_KEEPS * np.maximum(lids.upper, lids.lower)
    left = smoothstep(-SIDE_BLEND_MM, SIDE_BLEND_MM, template.points[:, 0])
    jaw = jaw_share(template, canvas)
    rows = []
    for unit in UNITS:
        field = unit_field(canvas, unit)[:-ANCHORS] * free[:, None]
        field += jaw[:, None] * np.asarray(unit.jaw_slide)
        rows += [(field * share[:, None]).ravel() for share in (left, 1.0 - left)]
    assert len(canvas.points) == count + ANCHORS
    return ActionBasis(UNITS, np.array(rows, dtype=np.float32), jaw)


def subject_columns(
    basis: ActionBasis, lids: Lids, neutral: Array, globes: Array
) -> NDArray[np.float32]:
    """Lid and jaw columns (LID_COLUMNS + JAW_COLUMNS, V * 3) of a subject.

    neutral: (V, 3) mm; globes: (2, 3) the centres of the left and right globe.
    """
    columns = np.zeros((LID_COLUMNS + JAW_COLUMNS, len(neutral), 3), dtype=np.float32)
    for number, field in enumerate(closing(neutral, globes, lids)):
        columns[2 * number, lids.index] = field * lids.left[:, None]
        columns[2 * number + 1, lids.index] = field * ~lids.left[:, None]
    away = neutral - np.asarray(TMJ)
    columns[LID_COLUMNS, :, 1] = -basis.jaw * away[:, 2]  # turning about +x by t > 0 drops the chin
    columns[LID_COLUMNS, :, 2] = basis.jaw * away[:, 1]
    columns[LID_COLUMNS + 1, :, 1:] = -basis.jaw[:, None] * away[:, 1:]
    return columns.reshape(len(columns), -1)


def side_intensities(expression: Mapping[str, float]) -> Array:
    """(units, 2) left and right intensity in [0, 1]. Raises ConfigError for unknown units."""
    names = {unit.name: number for number, unit in enumerate(UNITS)}
    sides = np.zeros((len(UNITS), 2))
    for name, value in expression.items():
        stem, _, side = name.partition("_")
        if stem not in names or side not in ("", *SIDES):
            raise ConfigError(f"no action unit {name!r}; {did_you_mean(name, names)}")
        for number, letter in enumerate(SIDES):
            if side in ("", letter):
                sides[names[stem], number] += value
    return np.clip(sides, 0.0, 1.0)


def coefficients(expressions: Sequence[Mapping[str, float]]) -> NDArray[np.float32]:
    """(frames, 2 * units + LID_COLUMNS + JAW_COLUMNS): weights of the basis' rows."""
    rows = []
    lid = np.array([[unit.upper_lid, unit.lower_lid] for unit in UNITS])
    jaw = np.array([unit.jaw_deg for unit in UNITS])
    for expression in expressions:
        sides = side_intensities(expression)
        upper, lower = np.clip(lid.T @ sides, -0.5, 2.0)
        upper = np.minimum(upper, 1.0)
        lower = np.minimum(lower, 1.0 + 0.8 * (1.0 - upper))
        turn = np.deg2rad(min(float(jaw @ sides.max(axis=1)), JAW_LIMIT_DEG))
        rows.append(
            np.concatenate(
                [sides.ravel(), upper, upper**2, lower, lower**2, [np.sin(turn), 1 - np.cos(turn)]]
            )
        )
    return np.array(rows, dtype=np.float32)
