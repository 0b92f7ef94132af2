"""Convert action unit intensities to displacements: skin pulls, lid motion, jaw rotation.

A frame is ``neutral + coefficients @ basis``. Skin pulls are the same for all subjects; lids and
jaw depend on the subject's geometry. A jaw rotation by angle t is linear in (sin t, 1 - cos t), a
lid closure a is linear in (a, a^2): the whole expression is one matrix product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, did_you_mean
from glsim.faces.procedural.actions import ACTION_UNITS, LOWER, UPPER, ActionUnit
from glsim.faces.procedural.falloff import Array, smoothstep
from glsim.faces.procedural.fields import ANCHORS, FieldPoints
from glsim.faces.procedural.lids import Lids, lid_closure
from glsim.faces.procedural.template import PART_EAR, PART_EYEBALL, PART_TEETH, Template
from glsim.geometry.products import product

TMJ = (0.0, -1.0, -78.0)  # axis of the temporomandibular joint, mm; just in front of the tragus
JAW_LIMIT_DEG = 22.0  # about 45 mm between the incisors; normal maximum 40-55 mm
SIDE_BLEND_MM = 12.0  # one-sided units fade over this distance at the midline
SIDEWAYS_MM = 10.0  # sideways pulls fade to 0 within this distance of the midline
LID_STIFFNESS = 0.85  # the lids take 1 - this of the skin pulls around them
SIDES = ("L", "R")
LEAST_PULL_MM = 1e-3  # the tails of Gaussians below are cut, so that a pull moves its region only
SPAN_BLOCK = 1536  # numbers per block: four rows of the grid
Spans = list[list[slice]]
LID_BASIS_ROWS = 8  # (upper, lower) x (linear, square) x (left, right)
JAW_BASIS_ROWS = 2


@dataclass(frozen=True, eq=False)
class ActionBasis:
    """The part of the expression basis shared by all subjects.

    Args:
        pulls: (2 * units, V * 3) float32 mm; rows are AU1_L, AU1_R, AU2_L...
        spans: per row, the slices that are not zero.
        jaw: (V,) weight of the jaw's rotation in [0, 1].
    """

    units: tuple[ActionUnit, ...]
    pulls: NDArray[np.float32]
    spans: Spans
    jaw: Array


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


def make_action_basis(template: Template, field_points: FieldPoints, lids: Lids) -> ActionBasis:
    """Build the skin pulls of all action units on the template."""
    count = len(template.points)
    free = np.where(np.isin(template.part, (PART_EAR, PART_EYEBALL, PART_TEETH)), 0.0, 1.0)
    free[lids.index] = 1.0 - LID_STIFFNESS * np.maximum(lids.upper, lids.lower)
    left = smoothstep(-SIDE_BLEND_MM, SIDE_BLEND_MM, template.points[:, 0])
    jaw = jaw_weight(template, field_points)
    rows = []
    for unit in ACTION_UNITS:
        field = unit_field(field_points, unit)[:-ANCHORS] * free[:, None]
        field += jaw[:, None] * np.asarray(unit.jaw_slide)
        rows += [(field * share[:, None]).ravel() for share in (left, 1.0 - left)]
    assert len(field_points.points) == count + ANCHORS
    pulls = np.array(rows, dtype=np.float32)
    pulls[np.abs(pulls) < LEAST_PULL_MM] = 0.0
    return ActionBasis(ACTION_UNITS, pulls, nonzero_spans(pulls), jaw)


def nonzero_spans(rows: NDArray[np.float32]) -> Spans:
    """Return the slices of each row of (R, N) that hold its numbers other than 0, in blocks."""
    found = []
    for row in rows:
        padded = np.pad(row != 0, (0, -len(row) % SPAN_BLOCK)).reshape(-1, SPAN_BLOCK).any(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], padded.astype(np.int8), [0]])))
        found.append([slice(a * SPAN_BLOCK, b * SPAN_BLOCK) for a, b in edges.reshape(-1, 2)])
    return found


def subject_basis(
    basis: ActionBasis, lids: Lids, neutral: Array, globes: Array
) -> NDArray[np.float32]:
    """Build a subject's lid and jaw rows of the basis, (LID_BASIS_ROWS + JAW_BASIS_ROWS, V * 3) mm.

    Args:
        neutral: (V, 3) mm.
        globes: (2, 3) mm, centres of the left and right eyeball.
    """
    rows = np.zeros((LID_BASIS_ROWS + JAW_BASIS_ROWS, len(neutral), 3), dtype=np.float32)
    for number, field in enumerate(lid_closure(neutral, globes, lids)):
        rows[2 * number, lids.index] = field * lids.left[:, None]
        rows[2 * number + 1, lids.index] = field * ~lids.left[:, None]
    away = neutral - np.asarray(TMJ)
    rows[LID_BASIS_ROWS, :, 1] = -basis.jaw * away[:, 2]  # t > 0 lowers the chin
    rows[LID_BASIS_ROWS, :, 2] = basis.jaw * away[:, 1]
    rows[LID_BASIS_ROWS + 1, :, 1:] = -basis.jaw[:, None] * away[:, 1:]
    return rows.reshape(len(rows), -1)


def side_intensities(expression: Mapping[str, float]) -> Array:
    """Return (units, 2) left and right intensities in [0, 1].

    Raises ConfigError for an unknown action unit.
    """
    names = {unit.name: number for number, unit in enumerate(ACTION_UNITS)}
    sides = np.zeros((len(ACTION_UNITS), 2))
    for name, value in expression.items():
        stem, _, side = name.partition("_")
        if stem not in names or side not in ("", *SIDES):
            raise ConfigError(f"no action unit {name!r}; {did_you_mean(name, names)}")
        for number, letter in enumerate(SIDES):
            if side in ("", letter):
                sides[names[stem], number] += value
    return np.clip(sides, 0.0, 1.0)


def coefficients(expressions: Sequence[Mapping[str, float]]) -> NDArray[np.float32]:
    """Return basis weights (frames, 2 * units + LID_BASIS_ROWS + JAW_BASIS_ROWS)."""
    rows = []
    lid = np.array([[unit.upper_lid, unit.lower_lid] for unit in ACTION_UNITS])
    jaw = np.array([unit.jaw_deg for unit in ACTION_UNITS])
    for expression in expressions:
        sides = side_intensities(expression)
        upper, lower = np.clip(product(lid.T, sides), -0.5, 2.0)
        upper = np.minimum(upper, 1.0)
        lower = np.minimum(lower, 1.0 + 0.8 * (1.0 - upper))
        turn = np.deg2rad(min(float((jaw * sides.max(axis=1)).sum()), JAW_LIMIT_DEG))
        rows.append(
            np.concatenate(
                [sides.ravel(), upper, upper**2, lower, lower**2, [np.sin(turn), 1 - np.cos(turn)]]
            )
        )
    return np.array(rows, dtype=np.float32)
