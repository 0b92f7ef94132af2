"""Load a mesh file of any format and align it with the canonical frame.

Colour: if a file has vertex or material colours, the albedo is 0.6 times luma over the median luma,
since most of a face is skin, which reflects 0.6 times as much as a white wall at 860 nm. This is a
plausible ranking of light and dark, not a measurement: skins differ less in the near infrared than
in visible light. Textures and files of a single colour are ignored.
"""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError, did_you_mean
from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.core.products import product
from glsim.faces.meshes.alignment import (
    Alignment,
    Turns,
    check_axes,
    check_unit,
    estimate_alignment,
)
from glsim.faces.meshes.gltf import read_gltf
from glsim.faces.meshes.obj import (
    EXTENSIONS,
    check_count,
    check_start,
    read_bytes,
    read_material_colours,
    read_obj,
    slices,
)
from glsim.faces.meshes.ply_off import read_off, read_ply

ALBEDO_RANGE: Final = (0.05, 0.95)  # hair has 0.05-0.3; nothing on a face is whiter than a wall
LUMA: Final = (0.2126, 0.7152, 0.0722)  # Rec. 709, on the file's display values

_READERS: Final = {".obj": read_obj, ".ply": read_ply, ".off": read_off}
_MATERIAL_FILES: Final = re.compile(r"\"[^\"]+\"|'[^']+'|.+?\.mtl(?=\s|$)|\S+", re.IGNORECASE)
#: Largest spread of luma in a file of a single colour, relative to its median. Chosen.
_ONE_COLOUR: Final = 1e-3

#: Ratio of two meshes' sizes, of which one has another unit: hair or shoulders make less.
_OTHER_UNIT: Final = 4.0

#: A triangle of a binary STL, after 80 bytes of text and the number of triangles.
_STL_ROW: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])

_LOG = logging.getLogger(__name__)


class _Part(NamedTuple):
    """One geometry: (V, 3) vertices, (F, 3) faces, (V, 3) RGB (NaN: without) or None, a doubt."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colours: NDArray[np.float64] | None
    doubt: str = ""


@dataclass(frozen=True, eq=False)
class FileMesh:
    """A mesh in its file's own unit and axes, without degenerate parts.

    Args:
        vertices: (V, 3) float64, finite, each used by a triangle.
        faces: (F, 3) int32, none degenerate.
        albedo: (V,) float32 or None.
        doubts: problems of the file that a person should check, one sentence each.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    albedo: NDArray[np.float32] | None
    degenerate: int
    doubts: tuple[str, ...] = ()

    def to_mesh(self, alignment: Alignment) -> Mesh:
        """Return the mesh in the canonical frame."""
        faces = self.faces[:, ::-1] if alignment.flip_winding else self.faces
        vertices_mm, faces = alignment.apply(self.vertices), np.ascontiguousarray(faces)
        return Mesh(vertices_mm, faces, self.albedo, two_sided=True)


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A mesh in the canonical frame, its alignment, and notes for the manifest."""

    mesh: Mesh
    alignment: Alignment
    notes: dict[str, object]


def load_mesh(
    path: Path | str, *, unit: str = "auto", axes: str = "auto", rotation_deg: Turns | None = None,
    recentre: bool = True,
) -> LoadedMesh:  # fmt: skip
    """Read a mesh and align it with the canonical frame (millimetres, y up, z out of the face).

    Args:
        unit: "auto", a name ("m", "dm", "cm", "mm", "inch") or a number of millimetres ("125").
        axes: "auto", or the file's axes that become canonical x, y, z ("+x-y-z").
        rotation_deg: turns about canonical x, y and z after ``axes``; None: found with the axes.
        recentre: move the origin to 45 mm behind the tip of the nose; else keep the file's.

    Raises ConfigError: an invalid setting; MeshError: a file that cannot be used.
    """
    check_unit(unit)
    check_axes(axes)
    path = Path(path)
    file_mesh = read_mesh(path)
    alignment = find_alignment(path, file_mesh, unit, axes, rotation_deg, recentre=recentre)
    notes = manifest_notes(file_mesh, alignment)
    return LoadedMesh(file_mesh.to_mesh(alignment), alignment, notes)


def find_alignment(
    path: Path, file_mesh: FileMesh, unit: str, axes: str, turns: Turns | None = None, **keep: bool
) -> Alignment:
    """Estimate the alignment of a mesh and log it; errors name the file."""
    choice: dict[str, Any] = {"unit": unit, "axes": axes, "rotation_deg": turns, **keep}
    try:
        alignment = estimate_alignment(file_mesh.vertices, file_mesh.faces, **choice)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    _LOG.info("%s: %s", path, alignment)
    return alignment


def find_alignment_in_format(
    path: Path, file_mesh: FileMesh, *, unit: str, axes: str, format_axes: str
) -> Alignment:
    """Find the alignment in a format with known axes, ``format_axes``, which "auto" takes.

    Raises MeshError also for a face that looks away or is upside down in them.
    """
    chosen = format_axes if axes == "auto" else axes
    alignment = find_alignment(path, file_mesh, unit, chosen)
    if axes == "auto" and alignment.better_axes:
        raise MeshError(
            f"{path}: the face looks away or stands on its head in the format's own axes "
            f"{format_axes}: {alignment.better_axes} fits better; set axes to what is right"
        )
    return alignment


def check_head_size(path: Path, mesh: Mesh, alignment: Alignment) -> Mesh:
    """Return the mesh if it is as large as its sequence's first one. Raises MeshError otherwise."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.ptp(mesh.vertices_mm, axis=0).max())
    if not 1 / _OTHER_UNIT < size / alignment.extent_mm < _OTHER_UNIT:
        raise MeshError(
            f"{path}: it is {size:.4g} mm across in the unit of its sequence, whose first mesh has "
            f"{alignment.extent_mm:.4g} mm; set its true unit, such as unit=cm, or mend it"
        )
    return mesh


def manifest_notes(file_mesh: FileMesh, alignment: Alignment) -> dict[str, object]:
    """Return the manifest's notes on a mesh."""
    notes = {**alignment.notes(), "doubts": [*alignment.doubts, *file_mesh.doubts]}
    if file_mesh.degenerate:
        notes["degenerate_triangles_dropped"] = file_mesh.degenerate
    return notes


def read_mesh(path: Path) -> FileMesh:
    """Read a mesh file in its own unit and axes, and drop degenerate parts. Raises MeshError."""
    suffix = path.suffix.lower()
    if path.is_dir():
        raise MeshError(
            f"{path}: is a folder, not a mesh: name a mesh in it, or take all by glsim generate "
            f"--source folder --root {path} -o NEW"
        )
    if suffix not in EXTENSIONS:
        raise MeshError(
            f"{path}: {suffix or 'a file without extension'} is not a mesh format glsim reads "
            f"({did_you_mean(suffix, EXTENSIONS)}); export it as OBJ or PLY"
        )
    others = {".stl": _read_stl, ".glb": read_gltf, ".gltf": read_gltf}
    read: Callable[[Path], Any] = others.get(suffix, _read_polygons)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            parts = [_weld(_Part(*part)) for part in read(path)]
    except MeshError:
        raise
    except Exception as error:  # what a parser meets in a damaged file
        reason = " ".join(str(error).split())[:120] or "no reason given"
        raise MeshError(
            f"{path}: damaged, cut short or not {suffix[1:].upper()} "
            f"({type(error).__name__}: {reason}); export it again"
        ) from error
    if not parts:
        raise MeshError(f"{path}: no triangles in it; export the surface, not points or lines")
    vertices, faces = _join(parts)
    if len(faces) == 0:
        raise MeshError(f"{path}: no triangles ({len(vertices)} points); export the surface too")
    check_count(path, len(faces))
    file_mesh = drop_degenerate(path, vertices, faces, _albedo_from_colours(parts))
    return replace(file_mesh, doubts=tuple(part.doubt for part in parts if part.doubt))


def merge_patches(patches: Sequence[FileMesh]) -> FileMesh:
    """Concatenate the patches of one surface, in order."""
    if len(patches) == 1:
        return patches[0]
    vertices, faces = _join(patches)
    albedos = [patch.albedo for patch in patches if patch.albedo is not None]
    return FileMesh(
        vertices,
        faces.astype(np.int32),
        np.concatenate(albedos) if len(albedos) == len(patches) else None,
        sum(patch.degenerate for patch in patches),
    )


def _join(parts: Sequence[_Part | FileMesh]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Concatenate vertices and triangles."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    return np.concatenate([part.vertices for part in parts]), np.concatenate(faces)


def drop_degenerate(
    path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64],
    albedo: NDArray[np.float32] | None,
) -> FileMesh:  # fmt: skip
    """Drop triangles (F, 3) without area and unused vertices (V, 3). Raises MeshError for NaN."""
    broken = np.logical_not(np.isfinite(vertices).all(axis=1))
    if broken.any() and len(bad := np.flatnonzero(broken[faces].any(axis=1))):
        raise MeshError(
            f"{path}: {len(bad)} of {len(faces)} triangles have a vertex at NaN or infinity "
            f"(first: triangle {bad[0]}); repair or remove them"
        )
    valid = _has_area(vertices, faces)
    if not valid.any():
        raise MeshError(f"{path}: all {len(faces)} triangles are degenerate (no area)")
    degenerate = int(len(faces) - valid.sum())
    faces = faces[valid] if degenerate else faces
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if not used.all():
        faces, vertices = (np.cumsum(used) - 1)[faces], vertices[used]
        albedo = None if albedo is None else albedo[used]
    return FileMesh(vertices, faces.astype(np.int32), albedo, degenerate)


def _has_area(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (F,) whether each triangle's cross product is not 0: twice as fast as np.cross."""
    area, columns = np.empty(len(faces), bool), vertices.T
    for part in slices(len(faces)):  # at once, this would be the most memory of all
        a, b, c = (columns[:, faces[part, corner]] for corner in range(3))
        with np.errstate(over="ignore", invalid="ignore"):  # absurd sizes: refused with the unit
            (ux, uy, uz), (vx, vy, vz) = b - a, c - a
            area[part] = (
                (uy * vz - uz * vy != 0) | (uz * vx - ux * vz != 0) | (ux * vy - uy * vx != 0)
            )
    return area


def _read_polygons(path: Path) -> list[_Part]:
    """Read an OBJ, PLY or OFF, with the colours of its vertices or materials if it has any."""
    file = _READERS[path.suffix.lower()](path)
    triangles, polygon = file.triangles(path)
    if file.colours is not None or file.materials is None:
        return [_Part(file.vertices, triangles, file.colours)]
    found, missing = _material_files(path.parent, file.libraries)
    colours: dict[str, tuple[float, float, float]] = {}
    for material_file in found:
        colours |= read_material_colours(material_file)
    materials = file.materials[polygon]
    if any(file.material_names[index] not in colours for index in np.unique(materials)):
        doubt = f"{', '.join(missing)} of its mtllib is not found: no albedo" if missing else ""
        return [_Part(file.vertices, triangles, None, doubt)]
    # A vertex on the border of two materials gets the colour of the later triangle.
    by_material = np.array([colours.get(name, (0.0, 0.0, 0.0)) for name in file.material_names])
    vertex_colours = np.zeros((len(file.vertices), 3))
    vertex_colours[triangles.ravel()] = np.repeat(by_material[materials], 3, axis=0)
    return [_Part(file.vertices, triangles, vertex_colours)]


def _material_files(folder: Path, libraries: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Return the files that ``mtllib`` lines name, and the names of no file.

    A line holds one name with spaces, or several names; each may be in quotes.
    """
    found: dict[str, Path | None] = {}
    for line in libraries:
        names = [name.strip(" '\"") for name in _MATERIAL_FILES.findall(line)]
        own = {name: _file_below(folder, name) for name in names}
        whole = None if any(own.values()) else _file_below(folder, line.strip("'\""))
        found |= {line: whole} if whole else own
    return [file for file in found.values() if file], [name for name in found if not found[name]]


def _file_below(folder: Path, name: str) -> Path | None:
    """Return the file of a relative path, or of its last part alone; upper case as lower case."""
    parts = name.replace("\\", "/").split("/")
    for tail in (parts, parts[-1:]):
        place: Path | None = folder
        for part in tail:
            beside = sorted(place.iterdir()) if place and place.is_dir() else []
            same = [entry for entry in beside if entry.name.casefold() == part.casefold()]
            place = next((e for e in same if e.name == part), same[0] if same else None)
        if place is not None and place.is_file():
            return place
    return None


def _read_stl(path: Path) -> list[_Part]:
    head = check_start(path, rb".{1,1000}", "STL")
    text = head[:5].lower() == b"solid" and b"facet" in head.lower()
    promised = int.from_bytes(head[80:84], "little")
    complete = (path.stat().st_size - 84) // _STL_ROW.itemsize
    if text:
        data = read_bytes(path)
        words = data.lower()
        promised, complete = words.count(b"facet normal"), words.count(b"endfacet")
    if complete < promised:
        raise MeshError(
            f"{path}: cut short: it has {max(complete, 0)} triangles of the {promised} it promises"
        )
    check_count(path, promised)
    if not text:
        data = read_bytes(path, 84 + promised * _STL_ROW.itemsize + 4096)
        rows = np.frombuffer(data, _STL_ROW, promised, 84)
        faces = np.arange(3 * promised).reshape(-1, 3)
        return [_Part(rows["corners"].reshape(-1, 3).astype(np.float64), faces, None)]
    import trimesh  # takes 0.2 s, and only some sources need it

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # otherwise it prints to stderr
    scene: Any = trimesh.load_scene(io.BytesIO(data), file_type="stl", process=False)
    meshes = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.Trimesh)]
    return [_Part(np.asarray(mesh.vertices), np.asarray(mesh.faces), None) for mesh in meshes]


def _weld(part: _Part) -> _Part:
    """Merge equal vertices if there is one for each corner, as in STL."""
    if len(part.vertices) != 3 * len(part.faces) or not len(part.faces):
        return part
    from trimesh.grouping import unique_rows

    first, number = unique_rows(part.vertices, keep_order=True)  # type: ignore[no-untyped-call]
    colours = None if part.colours is None else part.colours[first]
    return _Part(part.vertices[first], number[part.faces], colours)


def _albedo_from_colours(parts: list[_Part]) -> NDArray[np.float32] | None:
    """Return the (V,) albedo; None if a part has no colour or all colours are equal."""
    colours = [part.colours for part in parts if part.colours is not None]
    if len(colours) < len(parts):
        return None
    luma = product(np.concatenate(colours), np.array(LUMA))
    coloured = ~np.isnan(luma)
    middle = float(np.median(luma[coloured])) if coloured.any() else 0.0
    if np.isinf(luma).any() or middle <= 0 or np.ptp(luma[coloured]) < _ONE_COLOUR * middle:
        return None
    albedo = np.clip(SKIN_ALBEDO * np.where(coloured, luma / middle, 1.0), *ALBEDO_RANGE)
    return np.asarray(albedo, dtype=np.float32)
