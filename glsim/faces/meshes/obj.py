"""Read Wavefront OBJ: positions, polygons and material names, in the file's own vertex order.

trimesh splits vertices by texture coordinate; a morphable model needs the vertex order of the file.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.core.files.regular import open_regular, read_regular

EXTENSIONS: Final = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
"""Readable formats: OBJ by glsim, the others by trimesh without further packages."""

MAX_TRIANGLES: Final = 5_000_000
"""Largest number of triangles: a head in 0.3 mm triangles. More would need 0.4 GB of vertices for
detail that no depth camera sees."""

MAX_BYTES: Final = 200 * MAX_TRIANGLES
"""Largest file size, bytes: 200 per triangle; an OBJ with texture coordinates and normals needs
about 120."""

#: Largest material file that is read, bytes: exporters write a few kB.
_MAX_MATERIAL_BYTES = 1 << 24


@dataclass(frozen=True, eq=False)
class ObjFile:
    """The content of an OBJ file, without texture coordinates, normals and lines.

    Args:
        vertices: (V, 3) float64, the file's own unit.
        colours: (V, 3) float64 red, green, blue if the ``v`` lines have them, otherwise None.
        corners: (C,) int64, vertex indices of all polygons, concatenated, from 0.
        counts: (P,) int64, number of corners of each polygon, 3 or more.
        materials: (P,) int64, index into ``material_names`` of each polygon.
        material_names: names in ``usemtl`` lines; the first is "" (before any ``usemtl``).
        libraries: file names in ``mtllib`` lines.
    """

    vertices: NDArray[np.float64]
    colours: NDArray[np.float64] | None
    corners: NDArray[np.int64]
    counts: NDArray[np.int64]
    materials: NDArray[np.int64]
    material_names: tuple[str, ...]
    libraries: tuple[str, ...]

    def triangles(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Split polygons into fans: (T, 3) vertex indices and (T,) index of the source polygon."""
        fans = self.counts - 2
        polygon = np.repeat(np.arange(len(fans)), fans)
        first = (np.cumsum(self.counts) - self.counts)[polygon]
        step = np.arange(len(polygon)) - (np.cumsum(fans) - fans)[polygon]
        corner = np.stack([first, first + step + 1, first + step + 2], axis=1)
        return self.corners[corner], polygon


def check_size(path: Path, max_bytes: int = MAX_BYTES) -> None:
    """Check the size of a file. Raises MeshError if it is 0 or above ``max_bytes``."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    if size == 0:
        raise MeshError(f"{path}: the file is empty")
    if size > max_bytes:
        raise MeshError(
            f"{path}: {size / 1e6:.0f} MB is more than the {max_bytes / 1e6:.0f} MB allowed"
        )


def check_count(path: Path, triangles: int) -> None:
    """Raise MeshError for more than MAX_TRIANGLES triangles."""
    if triangles > MAX_TRIANGLES:
        raise MeshError(
            f"{path}: {triangles} triangles, the limit is {MAX_TRIANGLES}; "
            "simplify it (a depth camera sees 2.5 mm at 0.9 m)"
        )


def read_vertices(path: Path) -> NDArray[np.float64]:
    """Read only the ``v`` lines, (V, 3) float64. Raises MeshError."""
    return _vertices(path, _lines(path))[0]


def read_obj(path: Path) -> ObjFile:
    """Read the whole file. Raises MeshError: unreadable, broken line, vertex index out of range.

    Relative (negative) vertex numbers become absolute indices.
    """
    lines = _lines(path)
    vertices, colours = _vertices(path, lines)
    names = {"": 0}
    libraries: dict[str, None] = {}
    faces: list[bytes] = []
    vertices_before: list[int] = []
    materials: list[int] = []
    vertex_lines = material = 0
    for line in lines:
        if line.startswith(b"f "):
            faces.append(line[2:])
            materials.append(material)
            vertices_before.append(vertex_lines)
        elif line.startswith(b"v "):
            vertex_lines += 1
        elif line.startswith(b"usemtl"):
            material = names.setdefault(_text(line[6:]), len(names))
        elif line.startswith(b"mtllib"):
            libraries[_text(line[6:])] = None
    sizes = np.array([len(line.split()) for line in faces], dtype=np.int64)
    check_count(path, int(sizes.sum()) - 2 * len(sizes))
    corners = re.sub(rb"/[^ ]*", b"", b" ".join(faces)).split()
    try:
        numbers = np.array(corners, np.int64) if corners else np.empty(0, np.int64)
    except (ValueError, OverflowError):
        raise MeshError(f"{path}: a face line holds something else than vertex numbers") from None
    if len(sizes) and sizes.min() < 3:
        raise MeshError(f"{path}: a face line has {sizes.min()} corners; the file is cut short")
    relative = np.repeat(np.array(vertices_before, dtype=np.int64), sizes)
    numbers = np.where(numbers < 0, numbers + relative, numbers - 1)
    bad = np.flatnonzero((numbers < 0) | (numbers >= len(vertices)))
    if len(bad):
        raise MeshError(
            f"{path}: a face uses vertex {corners[bad[0]].decode()}, but there are "
            f"{len(vertices)} vertices; the file is damaged, export it again"
        )
    indices = np.array(materials, dtype=np.int64)
    return ObjFile(vertices, colours, numbers, sizes, indices, tuple(names), tuple(libraries))


def read_material_colours(path: Path) -> dict[str, tuple[float, float, float]]:
    """Read the diffuse colour (``Kd``) of each material in an MTL file; empty if unreadable."""
    try:
        lines = _lines(path, _MAX_MATERIAL_BYTES)
    except MeshError:
        return {}
    colours: dict[str, tuple[float, float, float]] = {}
    name = ""
    for line in lines:
        words = line.split()
        if words[:1] == [b"newmtl"]:
            name = _text(line.strip()[6:])
        elif words[:1] == [b"Kd"] and len(words) == 4:
            try:
                red, green, blue = (float(word) for word in words[1:])
            except ValueError:
                continue
            colours[name] = (red, green, blue)
    return colours


def _lines(path: Path, max_bytes: int = MAX_BYTES) -> list[bytes]:
    """Read the lines, joined at backslashes, with tabs as spaces. Raises MeshError."""
    try:
        data = read_regular(path, max_bytes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MeshError(f"{path}: cannot be read ({reason})") from None
    data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").replace(b"\t", b" ")
    lines = data.splitlines()
    return [line.lstrip() for line in lines] if b"\n " in data else lines


def _vertices(
    path: Path, lines: list[bytes]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Parse positions and colours of the ``v`` lines: x y z, x y z w or x y z r g b."""
    rows = [line[2:] for line in lines if line.startswith(b"v ")]
    if not any(row.partition(b"#")[0].strip() for row in rows):
        raise MeshError(f"{path}: no vertex lines ('v x y z'): this is not an OBJ mesh")
    try:
        table = np.loadtxt(rows, dtype=np.float64, ndmin=2)
    except ValueError as error:
        raise MeshError(f"{path}: a vertex line is broken ({error!s:.80})") from None
    if len(table) != len(rows) or table.shape[1] not in (3, 4, 6, 7):
        raise MeshError(
            f"{path}: a vertex line is empty, or has not 3 (x y z) or 6 (with colour) numbers"
        )
    return table[:, :3], table[:, -3:] if table.shape[1] >= 6 else None


def _text(data: bytes) -> str:
    return data.decode("utf-8", errors="replace").strip()
