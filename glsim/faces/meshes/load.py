"""Load a mesh file of any format and align it with the canonical frame.

Colour: if a file has vertex or material colours, the albedo is 0.6 times luma over the median
luma: most of a face is skin, and skin reflects 0.6 of what a white wall does at 860 nm. This is a
plausible ranking of light and dark, not a measurement: visible colour says little about the near
infrared, where skins differ less. Textures and files of a single colour are ignored.
"""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError, did_you_mean
from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.core.products import product
from glsim.faces.meshes.alignment import (
    MAX_HEAD_MM,
    MIN_HEAD_MM,
    Alignment,
    check_axes,
    check_unit,
    estimate_alignment,
)
from glsim.faces.meshes.obj import (
    EXTENSIONS,
    check_count,
    check_size,
    read_material_colours,
    read_obj,
)

ALBEDO_RANGE: Final = (0.05, 0.95)  # hair has 0.05-0.3; nothing on a face is whiter than a wall
LUMA: Final = (0.2126, 0.7152, 0.0722)  # Rec. 709, on the file's display values

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Part:
    """One geometry of a file: (V, 3) vertices, (F, 3) faces, (V, 3) RGB in [0, 1] or None."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colours: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class FileMesh:
    """A mesh in its file's own unit and axes, without degenerate parts.

    Args:
        vertices: (V, 3) float64, finite, each used by a triangle.
        faces: (F, 3) int32, none degenerate.
        albedo: (V,) float32 or None.
        degenerate: number of triangles without area that were dropped.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    albedo: NDArray[np.float32] | None
    degenerate: int

    def to_mesh(self, alignment: Alignment) -> Mesh:
        """Return the mesh in the canonical frame."""
        faces = self.faces[:, ::-1] if alignment.flip_winding else self.faces
        return Mesh(alignment.apply(self.vertices), np.ascontiguousarray(faces), self.albedo)


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A mesh in the canonical frame, its alignment, and notes for the manifest."""

    mesh: Mesh
    alignment: Alignment
    notes: dict[str, object]


def load_mesh(
    path: Path | str, *, unit: str = "auto", axes: str = "auto", recentre: bool = True
) -> LoadedMesh:
    """Read a mesh and align it with the canonical frame (millimetres, y up, z out of the face).

    Args:
        unit: "auto", a name ("m", "dm", "cm", "mm", "inch") or a number of millimetres ("125").
        axes: "auto", or the file's axes that become canonical x, y, z ("+x-y-z").
        recentre: move the origin to 45 mm behind the tip of the nose; otherwise keep the file's
            origin.

    Raises:
        ConfigError: an invalid setting.
        MeshError: a file that cannot be used.
    """
    check_unit(unit)
    check_axes(axes)
    path = Path(path)
    file_mesh = read_mesh(path)
    alignment = find_alignment(path, file_mesh, unit=unit, axes=axes, recentre=recentre)
    notes = manifest_notes(file_mesh, alignment)
    return LoadedMesh(file_mesh.to_mesh(alignment), alignment, notes)


def find_alignment(
    path: Path, file_mesh: FileMesh, *, unit: str, axes: str, recentre: bool
) -> Alignment:
    """Estimate the alignment of a mesh and log it. Errors name the file.

    Arguments and errors as for ``estimate_alignment``.
    """
    try:
        alignment = estimate_alignment(
            file_mesh.vertices, file_mesh.faces, unit=unit, axes=axes, recentre=recentre
        )
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    _LOG.info("%s: %s", path, alignment)
    return alignment


def find_alignment_in_format(
    path: Path, file_mesh: FileMesh, *, unit: str, axes: str, format_axes: str
) -> Alignment:
    """Find the alignment in a format with known axes: for "auto" these are taken and checked.

    Raises MeshError also for a face that looks away or is upside down in the format's axes.
    """
    chosen = format_axes if axes == "auto" else axes
    alignment = find_alignment(path, file_mesh, unit=unit, axes=chosen, recentre=True)
    if axes == "auto" and alignment.better_axes:
        raise MeshError(
            f"{path}: the face looks away or stands on its head in the format's own axes "
            f"{format_axes}: {alignment.better_axes} fits better; set axes to what is right"
        )
    return alignment


def check_head_size(path: Path, mesh: Mesh) -> Mesh:
    """Return the mesh if its largest side is 80 to 600 mm. Raises MeshError otherwise."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.ptp(mesh.vertices_mm, axis=0).max())
    if not MIN_HEAD_MM <= size <= MAX_HEAD_MM:
        raise MeshError(
            f"{path}: the head is {size:.4g} mm across in the unit of its sequence, and should be "
            f"{MIN_HEAD_MM:.0f} to {MAX_HEAD_MM:.0f} mm; set the unit, or mend the file"
        )
    return mesh


def manifest_notes(file_mesh: FileMesh, alignment: Alignment) -> dict[str, object]:
    """Return the manifest's notes on a mesh."""
    degenerate = file_mesh.degenerate
    dropped = {"degenerate_triangles_dropped": degenerate} if degenerate else {}
    return {**alignment.notes(), **dropped}


def read_mesh(path: Path) -> FileMesh:
    """Read a mesh file in its own unit and axes, and drop degenerate parts. Raises MeshError."""
    suffix = path.suffix.lower()
    if path.is_dir():
        raise MeshError(f"{path}: is a directory, not a mesh; the source 'folder' reads trees")
    if suffix not in EXTENSIONS:
        raise MeshError(
            f"{path}: {suffix or 'a file without extension'} is not a mesh format glsim reads "
            f"({did_you_mean(suffix, EXTENSIONS)}); export it as OBJ or PLY"
        )
    check_size(path)
    parts = [_read_obj_part(path)] if suffix == ".obj" else _read_scene(path)
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    if len(faces) == 0:
        raise MeshError(f"{path}: no triangles ({len(vertices)} points); export the surface too")
    check_count(path, len(faces))
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))[0]
        raise MeshError(
            f"{path}: triangle {wrong} uses vertex {faces[wrong].max()}, but there are "
            f"{len(vertices)} vertices; the file is damaged, export it again"
        )
    return drop_degenerate(path, vertices, faces, _albedo_from_colours(parts))


def merge_patches(patches: Sequence[FileMesh]) -> FileMesh:
    """Concatenate the patches of one surface, in order."""
    if len(patches) == 1:
        return patches[0]
    starts = np.cumsum([0, *(len(patch.vertices) for patch in patches[:-1])])
    faces = [patch.faces + np.int32(start) for patch, start in zip(patches, starts, strict=True)]
    albedos = [patch.albedo for patch in patches if patch.albedo is not None]
    return FileMesh(
        np.concatenate([patch.vertices for patch in patches]),
        np.concatenate(faces),
        np.concatenate(albedos) if len(albedos) == len(patches) else None,
        sum(patch.degenerate for patch in patches),
    )


def drop_degenerate(
    path: Path,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    albedo: NDArray[np.float32] | None,
) -> FileMesh:
    """Drop triangles without area and unused vertices. Raises MeshError for NaN and infinity.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        albedo: (V,) or None.
    """
    finite = np.isfinite(vertices)
    if not finite.all():
        broken = np.flatnonzero(~finite.all(axis=1))
        bad = np.flatnonzero(np.isin(faces, broken).any(axis=1))
    else:
        bad = np.empty(0, np.int64)
    if len(bad):
        raise MeshError(
            f"{path}: {len(bad)} of {len(faces)} triangles have a vertex at NaN or infinity "
            f"(first: triangle {bad[0]}); repair or remove them"
        )
    valid = _has_area(vertices, faces)
    if not valid.any():
        raise MeshError(f"{path}: all {len(faces)} triangles are degenerate (no area)")
    kept = faces if valid.all() else faces[valid]
    used = np.zeros(len(vertices), dtype=bool)
    used[kept] = True
    if used.all():
        return FileMesh(vertices, kept.astype(np.int32), albedo, int(len(faces) - len(kept)))
    number = np.cumsum(used) - 1
    return FileMesh(
        vertices[used],
        number[kept].astype(np.int32),
        None if albedo is None else albedo[used],
        int(len(faces) - len(kept)),
    )


def _has_area(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle's cross product is not 0.

    Computed by column, which is twice as fast as np.cross.
    """
    a, b, c = (vertices.T[:, faces[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", invalid="ignore"):  # absurd sizes are rejected with the unit
        (ux, uy, uz), (vx, vy, vz) = b - a, c - a
        return np.asarray(
            (uy * vz - uz * vy != 0) | (uz * vx - ux * vz != 0) | (ux * vy - uy * vx != 0)
        )


def _read_obj_part(path: Path) -> _Part:
    """Read an OBJ as one part, with the colours of its vertices or materials if it has any."""
    obj = read_obj(path)
    triangles, polygon = obj.triangles()
    if obj.colours is not None:
        return _Part(obj.vertices, triangles, obj.colours)
    colours: dict[str, tuple[float, float, float]] = {}
    for library in obj.libraries:
        colours |= read_material_colours(path.parent / Path(library.replace("\\", "/")).name)
    materials = obj.materials[polygon]
    if any(obj.material_names[index] not in colours for index in np.unique(materials)):
        return _Part(obj.vertices, triangles, None)
    # A vertex on the border of two materials gets the colour of the later triangle.
    by_material = np.array([colours.get(name, (0.0, 0.0, 0.0)) for name in obj.material_names])
    vertex_colours = np.zeros((len(obj.vertices), 3))
    vertex_colours[triangles.ravel()] = np.repeat(by_material[materials], 3, axis=0)
    return _Part(obj.vertices, triangles, vertex_colours)


def _read_scene(path: Path) -> list[_Part]:
    """Read all triangles of a file by trimesh, placed by its scene graph. Raises MeshError.

    ``process=False``: trimesh merges and drops nothing.
    """
    import trimesh  # takes 0.2 s, and only some sources need it

    suffix = path.suffix[1:].lower()
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # otherwise it prints to stderr
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            scene: Any = trimesh.load_scene(path, process=False)
            placed = [(*scene.graph[node],) for node in scene.graph.nodes_geometry]
            meshes = [
                (scene.geometry[name], transform)
                for transform, name in placed
                if isinstance(scene.geometry[name], trimesh.Trimesh)
            ]
            count = sum(len(mesh.faces) for mesh, _ in meshes)
            check_count(path, count)
            if suffix == "off" and count < _promised_faces(path):
                raise MeshError(f"{path}: cut short: it has {count} faces of those it promises")
            parts = [_part(mesh, np.asarray(transform)) for mesh, transform in meshes]
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


def _promised_faces(path: Path) -> int:
    """Return the number of faces in the head of an OFF file, which trimesh does not compare."""
    numbers = re.findall(rb"^\s*(?:[A-Z]*OFF)?\s*\d+\s+(\d+)", path.read_bytes()[:1000])
    return int(numbers[0]) if numbers else 0


def _part(geometry: Any, transform: NDArray[np.float64]) -> _Part:
    """Convert a trimesh geometry; a (4, 4) transform that mirrors also reverses the winding."""
    if len(geometry.vertices) == 3 * len(geometry.faces):  # STL: a vertex for each corner
        geometry.merge_vertices()
    vertices = np.asarray(geometry.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(geometry.faces, dtype=np.int64).reshape(-1, 3)
    vertices = product(vertices, transform[:3, :3].T) + transform[:3, 3]
    if np.linalg.det(transform[:3, :3]) < 0:
        faces = faces[:, ::-1]
    return _Part(vertices, faces, _colours(geometry.visual, len(vertices)))


def _colours(visual: Any, count: int) -> NDArray[np.float64] | None:
    """Return (V, 3) RGB from vertex colours or an untextured material; None without either."""
    if visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3]
        return colours / 255 if len(colours) == count else None
    material = getattr(visual, "material", None)
    textures = ("image", "baseColorTexture")
    if material is None or any(getattr(material, name, None) is not None for name in textures):
        return None
    return np.tile(np.asarray(material.main_color, dtype=np.float64)[:3] / 255, (count, 1))


def _albedo_from_colours(parts: list[_Part]) -> NDArray[np.float32] | None:
    """Return the (V,) albedo (see the module docstring).

    None if a part has no colour or all colours are equal.
    """
    colours = [part.colours for part in parts]
    if any(colour is None for colour in colours):
        return None
    every = np.concatenate([colour for colour in colours if colour is not None])
    luma = product(every, np.array(LUMA))
    middle = float(np.median(luma))
    if not np.isfinite(luma).all() or middle <= 0 or np.ptp(luma) < 1e-3 * middle:
        return None
    return np.asarray(np.clip(SKIN_ALBEDO * luma / middle, *ALBEDO_RANGE), dtype=np.float32)
