"""Read Wavefront OBJ: positions, polygons and material names, in the file's own vertex order.

trimesh splits vertices by texture coordinate; a morphable model needs the vertex order of the file.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.core.files.regular import read_regular

EXTENSIONS: Final = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
"""Readable formats: STL by trimesh, the others by glsim."""

#: Largest number of triangles: a head in triangles of 0.3 mm, finer than any depth camera sees; its
#: vertices need 0.4 GB.
MAX_TRIANGLES: Final = 5_000_000
#: Largest file, bytes: 200 per triangle; an OBJ with texture coordinates and normals needs 120.
MAX_BYTES: Final = 200 * MAX_TRIANGLES
#: Largest material file, bytes: exporters write a few kB.
_MAX_MATERIAL_BYTES = 1 << 24


@dataclass(frozen=True, eq=False)
class PolygonFile:
    """Polygons of an OBJ, PLY or OFF file, in its own unit and vertex order.

    Args:
        vertices: (V, 3) float64.
        colours: (V, 3) float64 red, green, blue, NaN = unknown; None: the file has no colours.
        corners: (C,) int64, vertex indices of all polygons, concatenated, from 0.
        counts: (P,) int64, number of corners of each polygon, 3 or more.
        materials: (P,) int64, index into ``material_names`` of each polygon.
        material_names: names in ``usemtl`` lines; the first is "" (before any ``usemtl``).
        libraries: what follows ``mtllib``, one text a line.
    """

    vertices: NDArray[np.float64]
    colours: NDArray[np.float64] | None
    corners: NDArray[np.int64]
    counts: NDArray[np.int64]
    materials: NDArray[np.int64] | None = None
    material_names: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()

    def fans(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Split polygons into fans: (T, 3) vertex indices and (T,) index of the source polygon."""
        fans = self.counts - 2
        polygon = np.repeat(np.arange(len(fans)), fans)
        starts = np.cumsum(self.counts) - self.counts
        first, fan = starts[polygon], np.cumsum(fans) - fans
        step = np.arange(len(polygon)) - fan[polygon]
        return self.corners[np.stack([first, first + step + 1, first + step + 2], axis=1)], polygon

    def triangles(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Split polygons as ``fans`` does, but hollow polygons by clipping their ears."""
        triangles, polygon = self.fans()
        starts, fan = np.cumsum(self.counts) - self.counts, np.cumsum(self.counts - 2)
        fan -= self.counts - 2
        if self.counts.max(initial=3) == 3:
            return triangles, polygon
        with np.errstate(all="ignore"):  # NaN and absurd sizes are refused afterwards
            a, b, c = (self.vertices[triangles[:, corner]] for corner in range(3))
            normal = np.cross(b - a, c - a)
            whole = np.add.reduceat(normal, fan)
            least = -1e-9 * (whole**2).sum(axis=1)
            hollow = np.unique(polygon[(normal * whole[polygon]).sum(axis=1) < least[polygon]])
        if not len(hollow):
            return triangles, polygon
        from mapbox_earcut import triangulate_float64  # few files have such polygons

        convex = ~np.isin(polygon, hollow)
        ears, source = [triangles[convex]], [polygon[convex]]
        for number in hollow:
            corners = self.corners[starts[number] : starts[number] + self.counts[number]]
            axis = int(np.abs(whole[number]).argmax())
            seen = self.vertices[corners][:, [(axis + 1) % 3, (axis + 2) % 3]]
            plane = seen if whole[number, axis] > 0 else seen[:, ::-1]
            ends = np.array([len(corners)], dtype=np.uint32)
            clipped = triangulate_float64(np.ascontiguousarray(plane), ends).reshape(-1, 3)
            new = corners[clipped]
            a, b, c = (self.vertices[new[:, corner]] for corner in range(3))
            missing = np.cross(b - a, c - a).sum(axis=0) - whole[number]
            if np.abs(missing).max() > 1e-6 * np.abs(whole[number]).max():  # a bent one lost an ear
                new = triangles[polygon == number]
            ears.append(new)
            source.append(np.full(len(new), number))
        return np.concatenate(ears), np.concatenate(source)


def check_count(path: Path, triangles: int) -> None:
    """Raise MeshError for more than MAX_TRIANGLES triangles."""
    if triangles > MAX_TRIANGLES:
        raise MeshError(
            f"{path}: {triangles} triangles, the limit is {MAX_TRIANGLES}; "
            "simplify it (a depth camera sees 2.5 mm at 0.9 m)"
        )


def check_corners(path: Path, corners: NDArray[np.int64], vertices: int, first: int = 0) -> None:
    """Raise MeshError for an index outside the vertices.

    Args:
        path: file that the error names.
        corners: indices of vertices, from 0.
        vertices: number of vertices.
        first: number that the file gives its first vertex.
    """
    bad = np.flatnonzero((corners < 0) | (corners >= vertices))
    if len(bad):
        raise MeshError(
            f"{path}: a face uses vertex {corners[bad[0]] + first}, but there are "
            f"{vertices} vertices; the file is damaged, export it again"
        )


def read_vertices(path: Path) -> NDArray[np.float64]:
    """Read only the ``v`` lines, (V, 3) float64. Raises MeshError."""
    return _vertices(path, _lines(path))[0]


def read_obj(path: Path) -> PolygonFile:
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
    for number in np.flatnonzero((sizes == 1) | (sizes == 2)):  # a triangle without area
        words = faces[number].split()
        faces[number] = b" ".join([*words, *words[-1:] * (3 - len(words))])
        sizes[number] = 3
    check_count(path, int(sizes.sum()) - 2 * len(sizes))
    corners = re.sub(rb"/[^ ]*", b"", b" ".join(faces)).split()
    try:
        numbers = np.array(corners, np.int64) if corners else np.empty(0, np.int64)
    except (ValueError, OverflowError):
        raise MeshError(f"{path}: a face line holds something else than vertex numbers") from None
    if len(sizes) and sizes.min() < 3:
        raise MeshError(f"{path}: a face line has no corners; the file is cut short")
    relative = np.repeat(np.array(vertices_before, dtype=np.int64), sizes)
    numbers = np.where(numbers < 0, numbers + relative, numbers - 1)
    check_corners(path, numbers, len(vertices), first=1)
    indices = np.array(materials, dtype=np.int64)
    return PolygonFile(vertices, colours, numbers, sizes, indices, tuple(names), tuple(libraries))


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


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """Read a file; a byte order mark is skipped, UTF-16 becomes UTF-8. Raises MeshError."""
    try:
        data = read_regular(path, max_bytes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MeshError(f"{path}: cannot be read ({reason})") from None
    if not data:
        raise MeshError(f"{path}: the file is empty")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", errors="replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def plain_nan(text: bytes) -> bytes:
    """Write the C library's names of no number, ``-nan(ind)`` and ``-1.#IND``, as ``nan``."""
    if b".#" in text or b"nan(" in text.lower():
        text = re.sub(rb"(?i)[-+]?(nan\(\w*\)|\b1\.#(ind|[qs]nan|inf)\d*)", b"nan", text)
    return text


def _lines(path: Path, max_bytes: int = MAX_BYTES) -> list[bytes]:
    """Read the lines without comments, joined at backslashes, tabs as spaces. Raises MeshError."""
    data = plain_nan(read_bytes(path, max_bytes)).replace(b"\t", b" ").replace(b"\r\n", b"\n")
    if b"\\\n" in data:  # one that ends a comment joins nothing
        data = re.sub(rb"(?m)^([vf ][^#\n]*)?#.*", rb"\1", data).replace(b"\\\n", b" ")
    lines = data.splitlines()
    if b"\n " in data:
        lines = [line.lstrip() for line in lines]
    if data.count(b"#") > data.count(b"\n#"):  # names of materials may have a #
        lines = [line.partition(b"#")[0] if line[:1] in b"vf" else line for line in lines]
    return lines


def _vertices(
    path: Path, lines: list[bytes]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Parse ``v`` lines: x y z, x y z w, x y z r g b, x y z w r g b; a missing colour is NaN."""
    rows = [line[2:] for line in lines if line.startswith(b"v ")]
    if not any(row.strip() for row in rows):
        raise MeshError(f"{path}: no vertex lines ('v x y z'): this is not an OBJ mesh")
    table = parse_rows(path, rows, (3, 4, 6, 7))
    colours = np.where(np.isnan(table[:, 6:7]), table[:, 3:6], table[:, 4:7])
    coloured = not np.isnan(colours).any(axis=1).all()
    return table[:, :3].copy(), colours if coloured else None


def parse_rows(path: Path, rows: list[bytes], sizes: Container[int]) -> NDArray[np.float64]:
    """Parse vertex lines as (V, 12), NaN after the end of a line. Raises MeshError.

    ``sizes``: allowed numbers of values in a line.
    """
    try:
        table = np.loadtxt(rows, dtype=np.float64, ndmin=2)
        lengths = {table.shape[1] if len(table) == len(rows) else 0}
    except ValueError:  # lines of several lengths, or broken lines
        words = [row.split() for row in rows]
        lengths = {len(line) for line in words}
        try:
            table = np.array([line + [b"nan"] * (12 - len(line)) for line in words], np.float64)
        except ValueError as error:
            raise MeshError(f"{path}: a vertex line is broken ({error!s:.80})") from None
    if not all(length in sizes for length in lengths):
        raise MeshError(
            f"{path}: a vertex line is broken: it has not 3 (x y z) or 6 (with colour) numbers"
        )
    return np.pad(table, ((0, 0), (0, 12 - table.shape[1])), constant_values=np.nan)


def _text(data: bytes) -> str:
    return data.decode("utf-8", errors="replace").strip()
