"""Read PLY, STL, glTF and OFF through trimesh; every failure becomes a MeshError."""

from __future__ import annotations

import io
import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError
from glsim.files.regular import read_regular
from glsim.geometry.products import product
from glsim.meshio.gltf import prepare_gltf
from glsim.meshio.limits import MAX_BYTES, check_count


@dataclass(frozen=True, eq=False)
class MeshPart:
    """One geometry of a file: (V, 3) vertices, (F, 3) faces, (V, 3) RGB in [0, 1] or None."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colours: NDArray[np.float64] | None


def read_parts(path: Path) -> list[MeshPart]:
    """Read all triangles of a file, transformed by its scene graph. Raises MeshError.

    ``process=False``: trimesh merges and drops nothing.
    """
    import trimesh  # takes 0.2 s, and only some sources need it

    suffix = path.suffix[1:].lower()
    files: dict[str, bytes]
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # otherwise it prints to stderr
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            data, files = read_regular(path, MAX_BYTES), {}
            if suffix in ("glb", "gltf"):
                data, files = prepare_gltf(path, data)
            # Of other files trimesh sees those in ``files`` only: no pictures, nothing outside.
            scene: Any = trimesh.load_scene(
                io.BytesIO(data), file_type=suffix, resolver=files, process=False
            )
            _check_instances(path, scene)
            parts = []
            for node in scene.graph.nodes_geometry:
                transform, name = scene.graph[node]
                geometry = scene.geometry[name]
                if isinstance(geometry, trimesh.Trimesh):
                    parts.append(_part(geometry, np.asarray(transform)))
    except MeshError:
        raise
    except Exception as error:  # trimesh's parsers raise exceptions of any type
        reason = " ".join(str(error).split())[:120] or "no reason given"
        raise MeshError(
            f"{path}: damaged, cut short or not {suffix.upper()} "
            f"({type(error).__name__}: {reason}); export it again"
        ) from error
    if not parts:
        raise MeshError(f"{path}: no triangles in it; export the surface, not points or lines")
    return parts


def _check_instances(path: Path, scene: Any) -> None:
    """Raise MeshError for too many triangles or vertices, each counted in every place it has."""
    count = 0
    for node in scene.graph.nodes_geometry:
        geometry = scene.geometry[scene.graph[node][1]]
        sizes = [len(getattr(geometry, name, ())) for name in ("vertices", "faces")]
        # An STL has a vertex for each corner until its corners are welded.
        count += sizes[1] if sizes[0] == 3 * sizes[1] else max(sizes)
    check_count(path, count)


def _part(geometry: Any, transform: NDArray[np.float64]) -> MeshPart:
    """Convert a trimesh geometry; a (4, 4) transform that mirrors also reverses the winding."""
    vertices = np.asarray(geometry.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(geometry.faces, dtype=np.int64).reshape(-1, 3)
    if len(vertices) == 3 * len(faces):  # STL: a vertex for each corner of each triangle
        vertices, faces = _weld(vertices, faces)
    vertices = product(vertices, transform[:3, :3].T) + transform[:3, 3]
    if np.linalg.det(transform[:3, :3]) < 0:
        faces = faces[:, ::-1]
    return MeshPart(vertices, faces, _colours(geometry.visual, len(vertices)))


def _weld(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Merge vertices at identical positions, in the order of first use."""
    rows = np.ascontiguousarray(vertices + 0.0).view(np.dtype((np.void, 24))).ravel()  # no -0.0
    _, first, inverse = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return vertices[first[order]], rank[inverse][faces]


def _colours(visual: Any, count: int) -> NDArray[np.float64] | None:
    """Return (V, 3) RGB from vertex colours or an untextured material; None without either."""
    if visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3]
        return colours / 255 if len(colours) == count else None
    material = getattr(visual, "material", None)
    if material is None or _is_textured(material):
        return None
    colour = np.asarray(material.main_color, dtype=np.float64)[:3] / 255
    return np.tile(colour, (count, 1))


def _is_textured(material: Any) -> bool:
    return any(getattr(material, name, None) is not None for name in ("image", "baseColorTexture"))
