"""Load a mesh file of any format and align it with the canonical frame.

Colour: if a file has vertex or material colours, the albedo is 0.6 times luma over the median
luma: most of a face is skin, and skin reflects 0.6 of what a white wall does at 860 nm. This is a
plausible ranking of light and dark, not a measurement: visible colour says little about the near
infrared, where skins differ less. Textures and files of a single colour are ignored.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError
from glsim.geometry.mesh import SKIN_ALBEDO, Mesh
from glsim.geometry.products import product
from glsim.meshio.alignment import (
    MAX_HEAD_MM,
    MIN_HEAD_MM,
    Alignment,
    check_axes,
    check_unit,
    estimate_alignment,
)
from glsim.meshio.limits import check_count, check_file
from glsim.meshio.obj import read_material_colours, read_obj
from glsim.meshio.ply import read_plain_ply
from glsim.meshio.scene import MeshPart, read_parts

ALBEDO_RANGE: Final = (0.05, 0.95)  # hair has 0.05-0.3; nothing on a face is whiter than a wall
LUMA: Final = (0.2126, 0.7152, 0.0722)  # Rec. 709, on the file's display values

_LOG = logging.getLogger(__name__)


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

    @property
    def frame(self) -> Alignment:
        """Deprecated name of ``alignment``."""
        warnings.warn("LoadedMesh.frame is now alignment", DeprecationWarning, stacklevel=2)
        return self.alignment


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
    path: Path,
    file_mesh: FileMesh,
    *,
    unit: str,
    axes: str,
    format_axes: str,
    recentre: bool,
) -> Alignment:
    """Find the alignment in a format with known axes: for "auto" these are taken and checked.

    Raises MeshError also for a face that looks away or is upside down in the format's axes.
    """
    chosen = format_axes if axes == "auto" else axes
    alignment = find_alignment(path, file_mesh, unit=unit, axes=chosen, recentre=recentre)
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
    declared = check_file(path)
    parts = _read_parts(path)
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    if len(faces) == 0:
        raise MeshError(f"{path}: no triangles ({len(vertices)} points); export the surface too")
    if len(faces) < declared:
        raise MeshError(
            f"{path}: cut short: {declared} faces are promised, {len(faces)} are there; "
            "copy or export it again"
        )
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


def _read_parts(path: Path) -> list[MeshPart]:
    """Read the parts of a file with the reader of its format."""
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return _read_obj_parts(path)
    plain = read_plain_ply(path) if suffix == ".ply" else None
    return [MeshPart(plain.vertices, plain.faces, None)] if plain else read_parts(path)


def _read_obj_parts(path: Path) -> list[MeshPart]:
    """Read an OBJ as one part, with the colours of its vertices or materials if it has any."""
    obj = read_obj(path)
    triangles, polygon = obj.triangles()
    if obj.colours is not None:
        return [MeshPart(obj.vertices, triangles, obj.colours)]
    colours: dict[str, tuple[float, float, float]] = {}
    for library in obj.libraries:
        colours |= read_material_colours(path.parent / Path(library.replace("\\", "/")).name)
    materials = obj.materials[polygon]
    if any(obj.material_names[index] not in colours for index in np.unique(materials)):
        return [MeshPart(obj.vertices, triangles, None)]
    # A vertex on the border of two materials gets the colour of the later triangle.
    by_material = np.array([colours.get(name, (0.0, 0.0, 0.0)) for name in obj.material_names])
    vertex_colours = np.zeros((len(obj.vertices), 3))
    vertex_colours[triangles.ravel()] = np.repeat(by_material[materials], 3, axis=0)
    return [MeshPart(obj.vertices, triangles, vertex_colours)]


def _albedo_from_colours(parts: list[MeshPart]) -> NDArray[np.float32] | None:
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
