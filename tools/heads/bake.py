"""Sculpt the template and all shapes of the heads, and write them as one file of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import occluder_of
from glsim.faces.procedural.lids import Lids
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.sparse_shapes import SparseShapes
from tools.heads.actions import ACTION_UNITS
from tools.heads.falloff import Array
from tools.heads.fields import ANCHORS, RigidParts, make_field_points, make_rigid_parts
from tools.heads.identity import FIELDS
from tools.heads.identity_parts import PART_FIELDS
from tools.heads.landmarks import landmark_vertices
from tools.heads.lids import make_lids
from tools.heads.pulls import jaw_weight, side_fields
from tools.heads.regions import cover_weights, make_regions
from tools.heads.template import Template, template
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
    arrays: Arrays = {
        "template_mm": head.points,
        "regions": make_regions(head),
        "landmarks": landmark_vertices(head),
        "jaw": jaw_weight(head, field_points),
        "cover": cover_weights(head),
        "anchors_mm": field_points.points[-ANCHORS:],
        "units": np.array([unit.name for unit in ACTION_UNITS]),
        "unit_lids": np.array([[unit.upper_lid, unit.lower_lid] for unit in ACTION_UNITS]),
        "unit_jaw_deg": np.array([unit.jaw_deg for unit in ACTION_UNITS]),
    }
    arrays |= {f"lids_{name}": getattr(lids, name) for name in Lids.__annotations__}
    arrays |= _shapes("identity", identity)
    arrays |= _shapes("pulls", side_fields(head, field_points, lid_weights))
    return _thinned(arrays | _rigid(rigid), head)


def _thinned(arrays: Arrays, head: Template) -> Arrays:
    """Add the triangles to the arrays, and leave out the vertices that nothing needs."""
    triangles = thinned_triangles(head, arrays["landmarks"])
    named = ("landmarks", "lids_index")
    kept = np.unique(np.concatenate([triangles.ravel(), *(arrays[name] for name in named)]))
    new = np.full(len(head.points), -1)
    new[kept] = np.arange(len(kept))
    for name in ("template_mm", "regions", "jaw"):
        arrays[name] = arrays[name][kept]
    arrays["cover"] = arrays["cover"][:, kept]
    for name in (*named, "lids_strips"):
        arrays[name] = new[arrays[name]]
    arrays["lids_linings"][..., 1] = new[arrays["lids_linings"][..., 1]]
    for name, others in (("identity", ("mm",)), ("pulls", ("mm",)), ("rigid", ("part", "weights"))):
        points = new[arrays[f"{name}_points"]]
        if name != "rigid":
            starts = np.concatenate([[0], np.cumsum(points >= 0)])[arrays[f"{name}_starts"]]
            arrays[f"{name}_starts"] = starts
        for other in others:
            arrays[f"{name}_{other}"] = arrays[f"{name}_{other}"][points >= 0]
        arrays[f"{name}_points"] = points[points >= 0].astype(arrays[f"{name}_points"].dtype)
    triangles = new[triangles]
    arrays["triangles"] = triangles.astype(np.uint16)
    arrays["occluder"] = occluder_of(arrays["template_mm"], triangles).astype(np.uint16)
    return arrays


def write_heads(path: Path) -> None:
    """Sculpt the heads and write them , compressed."""
    np.savez_compressed(path, allow_pickle=False, **sculpt())


def _shapes(name: str, fields: Mapping[str, Array]) -> Arrays:
    """Return the arrays of shapes, without what they move by less than LEAST_MM."""
    found = []
    for shape, field in fields.items():
        offsets = field.astype(np.float32)
        offsets[np.abs(offsets) < LEAST_MM] = 0.0
        points = np.flatnonzero(offsets.any(axis=1))
        found.append((shape, points, offsets[points]))
    arrays = SparseShapes.join(found).arrays(name)
    return arrays | {f"{name}_points": arrays[f"{name}_points"].astype(np.uint16)}


def _rigid(rigid: RigidParts) -> Arrays:
    """Return part number, vertex and weight of each vertex of a rigid part."""
    weights = [*rigid.eyes, *rigid.ears]
    points = [np.flatnonzero(weight) for weight in weights]
    return {
        "rigid_part": np.repeat(np.arange(len(points)), [len(part) for part in points]),
        "rigid_points": np.concatenate(points),
        "rigid_weights": np.concatenate([w[p] for w, p in zip(weights, points, strict=True)]),
    }
