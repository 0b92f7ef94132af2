"""One subject: its neutral head, its expression basis, and its frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.asymmetry import asymmetry_field
from glsim.faces.procedural.expression import (
    LEAST_PULL_MM,
    ActionBasis,
    Spans,
    coefficients,
    make_action_basis,
    nonzero_spans,
    subject_basis,
)
from glsim.faces.procedural.falloff import Array
from glsim.faces.procedural.fields import (
    FieldPoints,
    RigidParts,
    make_field_points,
    make_rigid_parts,
)
from glsim.faces.procedural.identity import FIELDS
from glsim.faces.procedural.identity_parts import PART_FIELDS
from glsim.faces.procedural.lids import Lids, make_lids
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.procedural.regions import draw_albedo, make_regions
from glsim.faces.procedural.template import PART_EYEBALL, Template, template
from glsim.faces.procedural.volumes import EYE_CENTER
from glsim.geometry.occluder import occluder_of


@dataclass(frozen=True, eq=False)
class HeadModel:
    """Data shared by all subjects; built once per process.

    Args:
        field_points, rigid: where fields are evaluated.
        identity: (parameters, V * 3) float32, mm per unit.
        identity_spans: the parts of its rows that are not 0.
        actions: shared expression basis.
        regions: (V,) uint8 indices into REGIONS.
        occluder: (F', 3) int32, see ``Mesh``.
    """

    template: Template
    field_points: FieldPoints
    rigid: RigidParts
    lids: Lids
    identity: NDArray[np.float32]
    identity_spans: Spans
    actions: ActionBasis
    regions: NDArray[np.uint8]
    occluder: NDArray[np.int32]


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
    identity[np.abs(identity) < LEAST_PULL_MM] = 0.0
    regions = make_regions(head)
    regions.setflags(write=False)
    actions = make_action_basis(head, field_points, lids)
    spans = nonzero_spans(identity)
    occluder = occluder_of(head.points, head.faces)
    return HeadModel(head, field_points, rigid, lids, identity, spans, actions, regions, occluder)


@dataclass(frozen=True, eq=False)
class Subject:
    """A person: neutral (V, 3) float64 mm, albedo (V,), and their lid and jaw rows of the basis.

    Args:
        own_spans: per row, the slices that are not zero.
    """

    neutral: Array
    albedo: NDArray[np.float32]
    own_basis: NDArray[np.float32]
    own_spans: Spans

    def frames(self, expressions: Sequence[Mapping[str, float]]) -> NDArray[np.float32]:
        """Return heads (frames, V, 3) float32 mm for expressions (action unit -> intensity)."""
        weights = coefficients(expressions)
        pulls = head_model().actions.pulls
        shared, own = weights[:, : len(pulls)], weights[:, len(pulls) :]
        heads = np.repeat(self.neutral.astype(np.float32).reshape(1, -1), len(weights), axis=0)
        for part, rows, spans in (
            (shared, pulls, head_model().actions.spans),
            (own, self.own_basis, self.own_spans),
        ):
            # one column at a time: the sum is bit-identical whatever else is in the batch
            for column in np.flatnonzero(part.any(axis=0)):
                row = rows[column]
                for moved in spans[column]:
                    for frame in np.flatnonzero(part[:, column]):
                        heads[frame, moved] += part[frame, column] * row[moved]
        return heads.reshape(len(weights), -1, 3)


def neutral_head(identity: Mapping[str, float]) -> Array:
    """Return the neutral head (V, 3) float64 mm of an identity (parameter -> value)."""
    shared = head_model()
    head = shared.template.points.ravel().copy()
    for p, field, spans in zip(PARAMETERS, shared.identity, shared.identity_spans, strict=True):
        for moved in spans:
            head[moved] += (identity[p.name] - p.template) * field[moved]
    return head.reshape(-1, 3)


def make_subject(identity: Mapping[str, float], seed: int, name: str) -> Subject:
    """Make the subject of an identity; ``seed`` and ``name`` give the asymmetry and the albedo."""
    shared = head_model()
    asymmetry = asymmetry_field(shared.field_points, shared.rigid, seed, name)
    albedo = draw_albedo(shared.template, shared.regions, seed, name, identity["hair_volume"])
    return subject_of(neutral_head(identity) + asymmetry, albedo)


def subject_of(neutral: Array, albedo: NDArray[np.float32]) -> Subject:
    """Make the subject with a neutral head (V, 3) mm and an albedo (V,)."""
    shared = head_model()
    ball, left = shared.template.part == PART_EYEBALL, shared.template.points[:, 0] > 0
    moved = neutral - shared.template.points
    globes = np.array(
        [
            np.array(EYE_CENTER) * (sign, 1, 1) + moved[ball & side].mean(axis=0)
            for sign, side in ((1.0, left), (-1.0, ~left))
        ]
    )
    own = subject_basis(shared.actions, shared.lids, neutral, globes)
    return Subject(neutral, albedo, own, nonzero_spans(own))
