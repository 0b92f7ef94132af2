"""Read the skeleton of the base mesh: bones, joints, and which vertices they move."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.files import BaseMesh, read_json
from glsim.faces.people.model import Skeleton
from glsim.faces.people.subdivision import LinearMap

_RIG: Final = "mpfb2/rigs/standard"


def read_rig(folder: Path, base: BaseMesh) -> tuple[Skeleton, LinearMap, NDArray[np.float64]]:
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
