"""Reading PLY, STL, glTF and OFF through trimesh, whatever it raises or warns about."""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError


@dataclass(frozen=True, eq=False)
class Part:
    """One geometry of a file: (V, 3) vertices, (F, 3) faces, (V, 3) red, green, blue or None."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colours: NDArray[np.float64] | None


def read_parts(path: Path) -> list[Part]:
    """All triangles of a file, placed as its scene says. Raises MeshError.

    Meshes are read as they stand (``process=False``: nothing merged, nothing dropped).
    """
    import trimesh  # 0.2 s, and only some sources need it

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints on stderr
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            scene: Any = trimesh.load_scene(path, process=False)
            parts = []
            for node in scene.graph.nodes_geometry:
                transform, name = scene.graph[node]
                geometry = scene.geometry[name]
                if isinstance(geometry, trimesh.Trimesh):
                    parts.append(_part(geometry, np.asarray(transform)))
    except Exception as error:  # trimesh raises whatever its parsers run into
        reason = " ".join(str(error).split())[:120] or "no reason given"
        raise MeshError(
            f"{path}: damaged, cut short or not {path.suffix[1:].upper()} "
            f"({type(error).__name__}: {reason}); export it again"
        ) from error
    if not parts:
        raise MeshError(f"{path}: no triangles in it; export the surface, not points or lines")
    return parts


def _part(geometry: Any, transform: NDArray[np.float64]) -> Part:
    vertices = np.asarray(geometry.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(geometry.faces, dtype=np.int64).reshape(-1, 3)
    if len(vertices) == 3 * len(faces):  # STL: three corners a triangle, each with its own vertex
        vertices, faces = _welded(vertices, faces)
    vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
    if np.linalg.det(transform[:3, :3]) < 0:
        faces = faces[:, ::-1]
    return Part(vertices, faces, _colours(geometry.visual, len(vertices)))


def _welded(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices at the very same place become one, in the order of their first use."""
    rows = np.ascontiguousarray(vertices + 0.0).view(np.dtype((np.void, 24))).ravel()  # no -0.0
    _, first, inverse = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return vertices[first[order]], rank[inverse][faces]


def _colours(visual: Any, count: int) -> NDArray[np.float64] | None:
    """Colour a vertex, or the one colour of a material without a texture."""
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
