"""Loading a mesh file of any format into the canonical frame.

Colour: where a file says how bright its parts are (colour a vertex, or a material), the albedo is
0.6 times luma over the median luma: most of a face is skin, and skin reflects 0.6 of what a white
wall does at 860 nm. It is a plausible ranking of light and dark, not a measurement: visible
colour says little about the near infrared, where skins differ less. Textures are left alone, as
are files of one colour only.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.canonical import (
    LARGEST_MM,
    SMALLEST_MM,
    Canonicalisation,
    canonicalise,
    check_axes,
    check_unit,
)
from glsim.errors import MeshError
from glsim.mesh import SKIN_ALBEDO, Mesh
from glsim.meshlimits import check_count, check_file
from glsim.objfile import read_material_colours, read_obj
from glsim.plyfile import read_plain_ply
from glsim.scenefile import Part, read_parts

ALBEDO_RANGE: Final = (0.05, 0.95)  # hair is 0.05-0.3; nothing on a face beats a white wall
LUMA: Final = (0.2126, 0.7152, 0.0722)  # Rec. 709, on the file's display values

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class RawMesh:
    """A mesh as its file has it: own unit, own axes; cleaned.

    vertices: (V, 3) float64, finite, each used by a triangle. faces: (F, 3) int32, none degenerate.
    albedo: (V,) float32 or None. degenerate: how many triangles without area were dropped.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    albedo: NDArray[np.float32] | None
    degenerate: int

    def to_mesh(self, frame: Canonicalisation) -> Mesh:
        """Into the canonical frame."""
        faces = self.faces[:, ::-1] if frame.flip_winding else self.faces
        return Mesh(frame.points(self.vertices), np.ascontiguousarray(faces), self.albedo)


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A mesh in the canonical frame, how it got there, and notes for the manifest."""

    mesh: Mesh
    frame: Canonicalisation
    notes: dict[str, object]


def load_mesh(
    path: Path | str, *, unit: str = "auto", axes: str = "auto", recentre: bool = True
) -> LoadedMesh:
    """Read a mesh and bring it into the canonical frame (millimetres, y up, z out of the face).

    unit: "auto", a name ("m", "dm", "cm", "mm", "inch") or a number of millimetres ("125").
    axes: "auto", or which axis of the file becomes canonical x, y, z ("+x-y-z").
    recentre: put the origin 45 mm behind the tip of the nose; otherwise the file's origin stays.
    Raises ConfigError for settings that mean nothing, MeshError for a file that cannot be used.
    """
    check_unit(unit)
    check_axes(axes)
    path = Path(path)
    raw = read_mesh(path)
    frame = find_frame(path, raw, unit=unit, axes=axes, recentre=recentre)
    return LoadedMesh(raw.to_mesh(frame), frame, notes_of(raw, frame))


def find_frame(
    path: Path, raw: RawMesh, *, unit: str, axes: str, recentre: bool
) -> Canonicalisation:
    """``canonicalise``, said aloud; the file's name is put into its errors."""
    try:
        frame = canonicalise(raw.vertices, raw.faces, unit=unit, axes=axes, recentre=recentre)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    _LOG.info("%s: %s", path, frame)
    return frame


def find_known_frame(
    path: Path,
    raw: RawMesh,
    *,
    unit: str,
    axes: str,
    format_axes: str,
    recentre: bool,
) -> Canonicalisation:
    """``find_frame`` for a format whose axes are known: "auto" takes them, and checks them.

    Raises MeshError too for a face that looks away or stands on its head in the format's axes.
    """
    chosen = format_axes if axes == "auto" else axes
    frame = find_frame(path, raw, unit=unit, axes=chosen, recentre=recentre)
    if axes == "auto" and frame.better_axes:
        raise MeshError(
            f"{path}: the face looks away or stands on its head in the format's own axes "
            f"{format_axes}: {frame.better_axes} fits better; set axes to what is right"
        )
    return frame


def sized(path: Path, mesh: Mesh) -> Mesh:
    """The mesh, if it is as large as a head can be in its frame's unit. Raises MeshError."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.ptp(mesh.vertices_mm, axis=0).max())
    if not SMALLEST_MM <= size <= LARGEST_MM:
        raise MeshError(
            f"{path}: the head is {size:.4g} mm across in the unit of its sequence, and should be "
            f"{SMALLEST_MM:.0f} to {LARGEST_MM:.0f} mm; set the unit, or mend the file"
        )
    return mesh


def notes_of(raw: RawMesh, frame: Canonicalisation) -> dict[str, object]:
    """What the manifest should say about a mesh."""
    dropped = {"degenerate_triangles_dropped": raw.degenerate} if raw.degenerate else {}
    return {**frame.notes(), **dropped}


def read_mesh(path: Path) -> RawMesh:
    """Read and clean a mesh file, in its own unit and axes. Raises MeshError."""
    promised = check_file(path)
    parts = _parts(path)
    vertices = np.concatenate([part.vertices for part in parts])
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    if len(faces) == 0:
        raise MeshError(f"{path}: no triangles ({len(vertices)} points); export the surface too")
    if len(faces) < promised:
        raise MeshError(
            f"{path}: cut short: {promised} faces are promised, {len(faces)} are there; "
            "copy or export it again"
        )
    check_count(path, len(faces))
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))[0]
        raise MeshError(
            f"{path}: triangle {wrong} uses vertex {faces[wrong].max()}, but there are "
            f"{len(vertices)} vertices; the file is damaged, export it again"
        )
    return clean(path, vertices, faces, _albedo(parts))


def merged(raws: Sequence[RawMesh]) -> RawMesh:
    """Patches of one surface, one after the other."""
    if len(raws) == 1:
        return raws[0]
    starts = np.cumsum([0, *(len(raw.vertices) for raw in raws[:-1])])
    faces = [raw.faces + np.int32(start) for raw, start in zip(raws, starts, strict=True)]
    albedos = [raw.albedo for raw in raws if raw.albedo is not None]
    return RawMesh(
        np.concatenate([raw.vertices for raw in raws]),
        np.concatenate(faces),
        np.concatenate(albedos) if len(albedos) == len(raws) else None,
        sum(raw.degenerate for raw in raws),
    )


def clean(
    path: Path,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    albedo: NDArray[np.float32] | None,
) -> RawMesh:
    """Drop triangles without area and vertices without triangle; refuse NaN and infinity."""
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
    whole = _with_area(vertices, faces)
    if not whole.any():
        raise MeshError(f"{path}: all {len(faces)} triangles are degenerate (no area)")
    kept = faces if whole.all() else faces[whole]
    used = np.zeros(len(vertices), dtype=bool)
    used[kept] = True
    if used.all():
        return RawMesh(vertices, kept.astype(np.int32), albedo, int(len(faces) - len(kept)))
    number = np.cumsum(used) - 1
    return RawMesh(
        vertices[used],
        number[kept].astype(np.int32),
        None if albedo is None else albedo[used],
        int(len(faces) - len(kept)),
    )


def _with_area(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(F,) whether a triangle's cross product is not 0; by column, twice as fast as np.cross."""
    a, b, c = (vertices.T[:, faces[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", invalid="ignore"):  # absurd sizes are refused with the unit
        (ux, uy, uz), (vx, vy, vz) = b - a, c - a
        return np.asarray(
            (uy * vz - uz * vy != 0) | (uz * vx - ux * vz != 0) | (ux * vy - uy * vx != 0)
        )


def _parts(path: Path) -> list[Part]:
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return _read_obj_parts(path)
    plain = read_plain_ply(path) if suffix == ".ply" else None
    return [Part(plain.vertices, plain.faces, None)] if plain else read_parts(path)


def _read_obj_parts(path: Path) -> list[Part]:
    """An OBJ as one part, or as one part a material where materials have colours."""
    obj = read_obj(path)
    triangles, polygon = obj.triangles()
    if obj.colours is not None:
        return [Part(obj.vertices, triangles, obj.colours)]
    colours: dict[str, tuple[float, float, float]] = {}
    for library in obj.libraries:
        colours |= read_material_colours(path.parent / Path(library.replace("\\", "/")).name)
    materials = obj.materials[polygon]
    if any(obj.material_names[index] not in colours for index in np.unique(materials)):
        return [Part(obj.vertices, triangles, None)]
    # A vertex on the border of two materials takes the colour of the later triangle.
    by_material = np.array([colours.get(name, (0.0, 0.0, 0.0)) for name in obj.material_names])
    of_vertex = np.zeros((len(obj.vertices), 3))
    of_vertex[triangles.ravel()] = np.repeat(by_material[materials], 3, axis=0)
    return [Part(obj.vertices, triangles, of_vertex)]


def _albedo(parts: list[Part]) -> NDArray[np.float32] | None:
    """See the head of this file. None where any part has no colour, or all have the same."""
    colours = [part.colours for part in parts]
    if any(colour is None for colour in colours):
        return None
    luma = np.concatenate([colour for colour in colours if colour is not None]) @ np.array(LUMA)
    middle = float(np.median(luma))
    if not np.isfinite(luma).all() or middle <= 0 or np.ptp(luma) < 1e-3 * middle:
        return None
    return np.asarray(np.clip(SKIN_ALBEDO * luma / middle, *ALBEDO_RANGE), dtype=np.float32)
