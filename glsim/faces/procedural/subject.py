"""One subject: its neutral head, its expression basis, and its frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.expression import (
    ActionBasis,
    coefficients,
    make_action_basis,
    subject_basis,
)
from glsim.faces.procedural.falloff import Array
from glsim.faces.procedural.fields import make_field_points, make_rigid_parts
from glsim.faces.procedural.identity import FIELDS
from glsim.faces.procedural.identity_parts import PART_FIELDS
from glsim.faces.procedural.lids import Lids, make_lids
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.procedural.regions import draw_albedo, make_regions
from glsim.faces.procedural.template import PART_EYEBALL, Template, template
from glsim.faces.procedural.volumes import EYE_CENTER


@dataclass(frozen=True, eq=False)
class HeadModel:
    """Data shared by all subjects; built once per process.

    identity: (parameters, V * 3) float32, mm per unit. actions: shared expression basis.
    regions: (V,) uint8 indices into REGIONS.
    """

    template: Template
    lids: Lids
    identity: NDArray[np.float32]
    actions: ActionBasis
    regions: NDArray[np.uint8]


@lru_cache(maxsize=1)
def head_model() -> HeadModel:
    """Return the model; built once per process in about a second."""
    head = template()
    field_points, rigid, lids = make_field_points(head), make_rigid_parts(head), make_lids(head)
    rows = [
        rigid.apply(FIELDS[p.name](field_points))
        if p.name in FIELDS
        else PART_FIELDS[p.name](head, lids)
        for p in PARAMETERS
    ]
    identity = np.array([row.ravel() for row in rows], dtype=np.float32)
    regions = make_regions(head)
    regions.setflags(write=False)
    return HeadModel(head, lids, identity, make_action_basis(head, field_points, lids), regions)


@dataclass(frozen=True, eq=False)
class Subject:
    """A person: neutral (V, 3) float64 mm, albedo (V,), and their lid and jaw rows of the basis."""

    neutral: Array
    albedo: NDArray[np.float32]
    own_basis: NDArray[np.float32]

    def frames(self, expressions: Sequence[Mapping[str, float]]) -> NDArray[np.float32]:
        """Return heads (frames, V, 3) float32 mm for expressions (action unit -> intensity)."""
        weights = coefficients(expressions)
        pulls = head_model().actions.pulls
        shared, own = weights[:, : len(pulls)], weights[:, len(pulls) :]
        heads = np.repeat(self.neutral.astype(np.float32).reshape(1, -1), len(weights), axis=0)
        for part, rows in ((shared, pulls), (own, self.own_basis)):
            # one column at a time: the sum is bit-identical whatever else is in the batch
            for column in np.flatnonzero(part.any(axis=0)):
                used = np.flatnonzero(part[:, column])
                heads[used] += part[used, column, None] * rows[column]
        return heads.reshape(len(weights), -1, 3)


def neutral_head(identity: Mapping[str, float]) -> Array:
    """Return the neutral head (V, 3) float64 mm of an identity (parameter -> value)."""
    shared = head_model()
    head = shared.template.points.ravel().copy()
    for p, field in zip(PARAMETERS, shared.identity, strict=True):
        head += (identity[p.name] - p.template) * field
    return head.reshape(-1, 3)


def make_subject(identity: Mapping[str, float], seed: int, name: str) -> Subject:
    """Make the subject of an identity; ``seed`` and ``name`` determine the albedo."""
    shared = head_model()
    neutral = neutral_head(identity)
    ball, left = shared.template.part == PART_EYEBALL, shared.template.points[:, 0] > 0
    moved = neutral - shared.template.points
    globes = np.array(
        [
            np.array(EYE_CENTER) * (sign, 1, 1) + moved[ball & side].mean(axis=0)
            for sign, side in ((1.0, left), (-1.0, ~left))
        ]
    )
    return Subject(
        neutral,
        draw_albedo(shared.template, shared.regions, seed, name, identity["hair_volume"]),
        subject_basis(shared.actions, shared.lids, neutral, globes),
    )
