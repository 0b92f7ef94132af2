"""Sculpt the template and all shapes of the heads, and write them as one file of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import occluder_of
from glsim.faces.procedural.lids import Lids
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.sparse_shapes import SparseShapes
from tools.heads.actions import ACTION_UNITS
from tools.heads.falloff import Array, IntArray
from tools.heads.fields import ANCHORS, RigidParts, make_field_points, make_rigid_parts
from tools.heads.identity import FIELDS
from tools.heads.identity_parts import PART_FIELDS
from tools.heads.landmarks import landmark_vertices
from tools.heads.lids import make_lids
from tools.heads.pulls import jaw_weight, side_fields
from tools.heads.regions import cover_weights, make_regions
from tools.heads.template import template
from tools.heads.thinning import thinned_triangles

LEAST_MM = 1e-3  # the tails of Gaussians below are cut, so that a shape moves its region only

Arrays = dict[str, NDArray[Any]]


def sculpt() -> Arrays:
    """Return the arrays that ``glsim.faces.procedural.model`` reads, by their names in the file."""
    head = template()
    field_points, rigid = make_field_points(head), make_rigid_parts(head)
    lid_weights, lids = make_lids(head)
    identity = {
        p.name: rigid.apply(FIELDS[p.name](field_points))
        if p.name in FIELDS
        else PART_FIELDS[p.name](head, lid_weights)
        for p in PARAMETERS
    }
    landmarks = landmark_vertices(head)
    triangles = thinned_triangles(head, landmarks)
    kept = np.unique(np.concatenate([triangles.ravel(), landmarks, lids.index]))
    #: Vertex of the template -> its number among those that are kept.
    number = np.full(len(head.points), -1)
    number[kept] = np.arange(len(kept))
    template_mm, triangles = head.points[kept], number[triangles]
    column, lining = np.moveaxis(lids.linings, -1, 0)
    lids = replace(
        lids,
        index=number[lids.index],
        strips=number[lids.strips],
        linings=np.stack([column, number[lining]], axis=-1),
    )
    arrays: Arrays = {
        "template_mm": template_mm,
        "triangles": triangles.astype(np.uint16),
        "occluder": occluder_of(template_mm, triangles).astype(np.uint16),
        "regions": make_regions(head)[kept],
        "landmarks": number[landmarks],
        "jaw": jaw_weight(head, field_points)[kept],
        "cover": cover_weights(head)[:, kept],
        "anchors_mm": field_points.points[-ANCHORS:],
        "units": np.array([unit.name for unit in ACTION_UNITS]),
        "unit_lids": np.array([[unit.upper_lid, unit.lower_lid] for unit in ACTION_UNITS]),
        "unit_jaw_deg": np.array([unit.jaw_deg for unit in ACTION_UNITS]),
    }
    arrays |= {f"lids_{name}": getattr(lids, name) for name in Lids.__annotations__}
    arrays |= _shapes("identity", identity, kept)
    arrays |= _shapes("pulls", side_fields(head, field_points, lid_weights), kept)
    return arrays | _rigid(rigid, kept)


def write_heads(path: Path) -> None:
    """Sculpt the heads and write them, compressed."""
    np.savez_compressed(path, allow_pickle=False, **sculpt())


def _shapes(name: str, fields: Mapping[str, Array], kept: IntArray) -> Arrays:
    """Return the arrays of shapes of the kept vertices that move by LEAST_MM or more."""
    found = []
    for shape, field in fields.items():
        offsets = field[kept].astype(np.float32)
        offsets[np.abs(offsets) < LEAST_MM] = 0.0
        points = np.flatnonzero(offsets.any(axis=1))
        found.append((shape, points, offsets[points]))
    arrays = SparseShapes.join(found).arrays(name)
    return arrays | {f"{name}_points": arrays[f"{name}_points"].astype(np.uint16)}


def _rigid(rigid: RigidParts, kept: IntArray) -> Arrays:
    """Return part number, vertex and weight of each kept vertex of a rigid part."""
    weights = [weight[kept] for weight in (*rigid.eyes, *rigid.ears)]
    points = [np.flatnonzero(weight) for weight in weights]
    return {
        "rigid_part": np.repeat(np.arange(len(points)), [len(part) for part in points]),
        "rigid_points": np.concatenate(points),
        "rigid_weights": np.concatenate([w[p] for w, p in zip(weights, points, strict=True)]),
    }
