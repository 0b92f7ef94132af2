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
    subject_columns,
)
from glsim.faces.procedural.fields import make_canvas, make_rigid
from glsim.faces.procedural.identity import FIELDS
from glsim.faces.procedural.identity_parts import PART_FIELDS
from glsim.faces.procedural.lids import Lids, make_lids
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.procedural.regions import draw_albedo, make_regions
from glsim.faces.procedural.sculpt import Array
from glsim.faces.procedural.template import PART_EYEBALL, Template, template
from glsim.faces.procedural.volumes import EYE_CENTER


@dataclass(frozen=True, eq=False)
class Model:
    """What all subjects share; built once a process.

    identity: (parameters, V * 3) float32 mm a unit. actions: the expression basis. regions: (V,).
    """

    template: Template
    lids: Lids
    identity: NDArray[np.float32]
    actions: ActionBasis
    regions: NDArray[np.uint8]


@lru_cache(maxsize=1)
def model() -> Model:
    """The model (about a second, once a process)."""
    head = template()
    canvas, rigid, lids = make_canvas(head), make_rigid(head), make_lids(head)
    rows = [
        rigid.settle(FIELDS[p.name](canvas))
        if p.name in FIELDS
        else PART_FIELDS[p.name](head, lids)
        for p in PARAMETERS
    ]
    identity = np.array([row.ravel() for row in rows], dtype=np.float32)
    regions = make_regions(head)
    regions.setflags(write=False)
    return Model(head, lids, identity, make_action_basis(head, canvas, lids), regions)


@dataclass(frozen=True, eq=False)
class Subject:
    """A person: neutral (V, 3) float64 mm, albedo (V,), lid and jaw columns of the basis."""

    neutral: Array
    albedo: NDArray[np.float32]
    own_columns: NDArray[np.float32]

    def frames(self, expressions: Sequence[Mapping[str, float]]) -> NDArray[np.float32]:
        """Heads (frames, V, 3) float32 mm for a batch of expressions (unit -> intensity)."""
        weights = coefficients(expressions)
        pulls = model().actions.pulls
        shared, own = weights[:, : len(pulls)], weights[:, len(pulls) :]
        heads = np.repeat(self.neutral.astype(np.float32).reshape(1, -1), len(weights), axis=0)
        for part, rows in ((shared, pulls), (own, self.own_columns)):
            # one column at a time: the same sum, bit by bit, whatever else is in the batch
            for column in np.flatnonzero(part.any(axis=0)):
                used = np.flatnonzero(part[:, column])
                heads[used] += part[used, column, None] * rows[column]
        return heads.reshape(len(weights), -1, 3)


def neutral_head(identity: Mapping[str, float]) -> Array:
    """The neutral head (V, 3) float64 mm of an identity (parameter -> value)."""
    shared = model()
    head = shared.template.points.ravel().copy()
    for p, field in zip(PARAMETERS, shared.identity, strict=True):
        head += (identity[p.name] - p.template) * field
    return head.reshape(-1, 3)


def make_subject(identity: Mapping[str, float], seed: int, name: str) -> Subject:
    """The subject of an identity; ``seed`` and ``name`` decide the albedo."""
    shared = model()
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
        subject_columns(shared.actions, shared.lids, neutral, globes),
    )
