"""Read and write Wavefront OBJ files: positions, polygons, material names, order of vertices.

trimesh splits vertices by texture coordinate; a morphable model needs the vertex order of the file.
"""

from __future__ import annotations

import codecs
import io
import re
import warnings
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glsim.core.errors import MeshError
from glsim.core.files.regular import open_regular, read_regular

EXTENSIONS: Final = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
"""Readable formats: STL by trimesh, the others by glsim."""

#: Largest number of triangles: a head in triangles of 0.3 mm, finer than any depth camera sees; its
#: vertices need 0.4 GB.
MAX_TRIANGLES: Final = 5_000_000
#: Largest file, bytes: 200 per triangle; an OBJ with texture coordinates and normals needs 120.
MAX_BYTES: Final = 200 * MAX_TRIANGLES
#: Largest material file, bytes: exporters write a few kB.
_MAX_MATERIAL_BYTES = 1 << 24
#: Largest number of letters in ``mtllib`` lines; each name is looked up in the folder. Chosen.
_MAX_NAMES = 4096
#: Number of triangles, and of bytes of face lines, that are computed at once. Chosen.
_PART, _PART_BYTES = 1 << 16, 1 << 20
#: Largest header, bytes; writers of PLY need up to 4 kB.
_MAX_HEADER_BYTES = 1 << 16
#: Largest sum of the squared numbers of corners of the hollow polygons: clipping their ears takes
#: up to 7 ns times it (measured, at points in a random order), 4 s.
_MAX_CLIPPING = 500_000_000


def encode_obj(vertices_mm: NDArray[np.floating[Any]], triangles: NDArray[np.integer]) -> bytes:
    """Encode (V, 3) vertices, mm, and (T, 3) triangles, counted from 0, as an OBJ file."""
    lines = ["# glsim; millimetres"]
    lines += ["v {:.4f} {:.4f} {:.4f}".format(*vertex) for vertex in vertices_mm.tolist()]
    lines += ["f {} {} {}".format(*corners) for corners in (triangles + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


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

    def checked(self, path: Path, first: int = 0) -> PolygonFile:
        """Return the polygons without points and lines.

        Raises MeshError, which names the file, for too many triangles, and for a corner outside
        the vertices, of which the file gives the first the number ``first``.
        """
        check_corners(path, self.corners, len(self.vertices), first)
        area = self.counts > 2
        check_count(path, int((self.counts[area] - 2).sum()))
        if area.all():
            return self
        materials = None if self.materials is None else self.materials[area]
        corners, counts = self.corners[np.repeat(area, self.counts)], self.counts[area]
        return replace(self, corners=corners, counts=counts, materials=materials)

    def fans(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Split polygons into fans: (T, 3) vertex indices and (T,) index of the source polygon."""
        fans = self.counts - 2
        polygon = np.repeat(np.arange(len(fans)), fans)
        if self.counts.max(initial=3) == 3:
            return self.corners.reshape(-1, 3), polygon
        starts = np.cumsum(self.counts) - self.counts
        first, fan = starts[polygon], np.cumsum(fans) - fans
        step = np.arange(len(polygon)) - fan[polygon]
        return self.corners[np.stack([first, first + step + 1, first + step + 2], axis=1)], polygon

    def triangles(self, path: Path) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Split polygons as ``fans`` does, but hollow polygons by clipping their ears.

        Raises MeshError, which names the file ``path``, for hollow polygons of too many corners.
        """
        triangles, polygon = self.fans()
        if self.counts.max(initial=3) == 3:
            return triangles, polygon
        fan = np.cumsum(self.counts - 2) - (self.counts - 2)
        with np.errstate(all="ignore"):  # NaN and absurd sizes are refused afterwards
            normals = self._normals(triangles)
            whole = np.add.reduceat(normals, fan)
            least = -1e-9 * (whole**2).sum(axis=1)
            for part in slices(len(normals)):
                normals[part] *= whole[polygon[part]]
            hollow = np.unique(polygon[normals.sum(axis=1) < least[polygon]])
        if not len(hollow):
            return triangles, polygon
        sizes = self.counts[hollow]
        if (sizes**2).sum() > _MAX_CLIPPING:
            raise MeshError(
                f"{path}: {len(hollow)} hollow polygons of up to {sizes.max()} corners take too "
                "long to split; export it as triangles"
            )
        convex = ~np.isin(polygon, hollow)
        parts, sources = [triangles[convex]], [polygon[convex]]
        ends = np.cumsum(self.counts)
        for number, size in zip(hollow, sizes, strict=True):
            normal, end = whole[number], ends[number]
            ears = self._ears(self.corners[end - size : end], normal)
            if len(ears) < size - 2:
                missing = np.abs(self._normals(ears).sum(axis=0) - normal).max()
                if missing > 1e-6 * np.abs(normal).max():  # a bent polygon lost an ear
                    ears = triangles[fan[number] : fan[number] + size - 2]
            parts.append(ears)
            sources.append(np.full(len(ears), number))
        return np.concatenate(parts), np.concatenate(sources)

    def _normals(self, triangles: NDArray[np.int64]) -> NDArray[np.float64]:
        normals = np.empty(triangles.shape)
        for part in slices(len(triangles)):
            a, b, c = (self.vertices[triangles[part, corner]] for corner in range(3))
            normals[part] = np.cross(b - a, c - a)
        return normals

    def _ears(self, corners: NDArray[np.int64], normal: NDArray[np.float64]) -> NDArray[np.int64]:
        """Split a polygon as it looks along the largest axis of its normal."""
        from mapbox_earcut import triangulate_float64  # few files have such polygons

        axis = int(np.abs(normal).argmax())
        x, y = ((axis + 1) % 3, (axis + 2) % 3)[:: 1 if normal[axis] > 0 else -1]
        plane = self.vertices[corners[:, None], [x, y]]
        return corners[triangulate_float64(plane, np.array([len(corners)], np.uint32))].reshape(
            -1, 3
        )


def slices(count: int) -> Iterator[slice]:
    """Yield the slices of a long array that are computed at once, so that little memory is used."""
    return (slice(start, start + _PART) for start in range(0, count, _PART))


def check_count(path: Path, triangles: int) -> None:
    """Raise MeshError for more than MAX_TRIANGLES triangles."""
    if triangles > MAX_TRIANGLES:
        raise MeshError(
            f"{path}: {triangles} triangles, the limit is {MAX_TRIANGLES}; "
            "simplify it (a depth camera sees 2.5 mm at 0.9 m)"
        )


def check_corners(path: Path, corners: NDArray[np.int64], vertices: int, first: int = 0) -> None:
    """Raise MeshError for an index, from 0, outside the vertices."""
    bad = np.flatnonzero((corners < 0) | (corners >= vertices))
    if len(bad):
        raise MeshError(
            f"{path}: a face uses vertex {corners[bad[0]] + first}, but there are "
            f"{vertices} vertices; the file is damaged, export it again"
        )


def read_vertices(path: Path) -> NDArray[np.float64]:
    """Read only the ``v`` lines, (V, 3) float64. Raises MeshError."""
    return _vertices(path, b"".join(line[2:] for line in _lines(path) if line[:2] == b"v "))[0]


def read_obj(path: Path) -> PolygonFile:
    """Read the whole file. Raises MeshError: unreadable, broken line, vertex index out of range.

    Relative (negative) vertex numbers become absolute indices.
    """
    names = {"": 0}
    libraries: dict[str, None] = {}
    # An object for each line would take ten times the size of the file.
    rows, faces = bytearray(), [bytearray()]
    counts, materials, vertices_before = array("q"), array("q"), array("q")
    vertex_lines = material = 0
    for line in _lines(path):
        if line.startswith(b"f "):
            if len(faces[-1]) > _PART_BYTES:
                faces.append(bytearray())
            faces[-1] += line[2:]
            counts.append(len(line.split()) - 1)
            materials.append(material)
            vertices_before.append(vertex_lines)
        elif line.startswith(b"v "):
            vertex_lines += 1
            rows += line[2:]
        elif line.startswith(b"usemtl"):
            material = names.setdefault(_text(line[6:]), len(names))
        elif line.startswith(b"mtllib"):
            libraries[_text(line[6:])] = None
    vertices, colours = _vertices(path, bytes(rows))
    sizes = np.array(counts, np.int64)
    check_count(path, int(sizes.sum()) - 2 * len(sizes))  # before their numbers take memory
    if sum(map(len, libraries)) > _MAX_NAMES:
        raise MeshError(f"{path}: its mtllib lines name too many files; remove them")
    numbers = np.concatenate(
        [parse_numbers(re.sub(rb"/[^ \n]*", b"", part), np.int64) for part in faces]
    )
    if not sizes.all():
        raise MeshError(f"{path}: a face line has no corners; the file is cut short")
    if len(numbers) != sizes.sum():
        raise MeshError(f"{path}: a face line holds something else than vertex numbers")
    relative = np.repeat(np.array(vertices_before, np.int64), sizes)
    corners = np.where(numbers < 0, numbers + relative, numbers - 1)
    return PolygonFile(
        vertices, colours, corners, sizes, np.array(materials, np.int64), tuple(names),
        tuple(libraries),
    ).checked(path, first=1)  # fmt: skip


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
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    return _plain_text(data)


def check_start(path: Path, pattern: bytes, kind: str) -> bytes:
    """Return the start of a file that matches a pattern, without the rest. Raises MeshError.

    ``pattern``: regular expression of the header, at most 64 kB.
    """
    try:
        with open_regular(path, MAX_BYTES) as file:
            found = re.match(pattern, _plain_text(file.read(_MAX_HEADER_BYTES)), re.DOTALL)
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    if found is None:
        reason = f"damaged, cut short or not {kind}" if path.stat().st_size else "the file is empty"
        raise MeshError(f"{path}: {reason}; export it again")
    return found[0]


def _plain_text(data: bytes) -> bytes:
    """Skip a byte order mark, and encode UTF-16 as UTF-8."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", errors="replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def plain_nan(text: bytes) -> bytes:
    """Write the C library's names of no number, ``-nan(ind)`` and ``-1.#IND``, as ``nan``."""
    if b".#" in text or b"nan(" in text.lower():
        text = re.sub(rb"(?i)[-+]?(nan\(\w*\)|\b1\.#(ind|[qs]nan|inf)\d*)", b"nan", text)
    return text


def _lines(path: Path, max_bytes: int = MAX_BYTES) -> Iterator[bytes]:
    """Yield the lines without comments, joined at backslashes, tabs as spaces. Raises MeshError."""
    check_start(path, rb"[^\0]+\Z", "text")
    data = plain_nan(read_bytes(path, max_bytes)).replace(b"\t", b" ").replace(b"\r\n", b"\n")
    data = data.replace(b"\r", b"\n")
    if b"\\\n" in data:  # one that ends a comment joins nothing
        data = re.sub(rb"(?m)^([vf ][^#\n]*)?#.*", rb"\1", data).replace(b"\\\n", b" ")
    indented = b"\n " in data
    remarks = data.count(b"#") > data.count(b"\n#")  # names of materials may have a #
    for line in io.BytesIO(data):
        if indented:
            line = line.lstrip(b" ")
        if remarks and line[:1] in b"vf" and b"#" in line:
            line = line.partition(b"#")[0] + b"\n"
        yield line


def _vertices(path: Path, rows: bytes) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Parse ``v`` lines: x y z, x y z w, x y z r g b, x y z w r g b; a missing colour is NaN."""
    if not rows.strip():
        raise MeshError(f"{path}: no vertex lines ('v x y z'): this is not an OBJ mesh")
    table = parse_rows(path, rows, (3, 4, 6, 7))
    if table.shape[1] < 6:
        return table[:, :3].copy(), None
    colours = table[:, 3:6]
    if table.shape[1] == 7:
        colours = np.where(np.isnan(table[:, 6:]), colours, table[:, 4:7])
    return table[:, :3].copy(), None if np.isnan(colours).any(axis=1).all() else colours


def parse_rows(path: Path, rows: bytes, sizes: Sequence[int]) -> NDArray[np.float64]:
    """Parse lines of vertices, of ``sizes`` values, as (V, K). Raises MeshError.

    K is that of the longest line; NaN stands after the end of a shorter line.
    """
    lengths = np.fromiter((len(line.split()) for line in io.BytesIO(rows)), np.int64)
    numbers = parse_numbers(rows, np.float64)
    if len(numbers) != lengths.sum() or not set(np.unique(lengths)).issubset(sizes):
        raise MeshError(
            f"{path}: a vertex line is broken: it has not 3 (x y z) or 6 (with colour) numbers"
        )
    table = np.full((len(lengths), lengths.max()), np.nan)
    table[np.arange(table.shape[1]) < lengths[:, None]] = numbers
    return table


def parse_numbers(text: bytes, kind: DTypeLike) -> NDArray[Any]:
    """Parse numbers between spaces and line breaks, up to what is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return np.fromstring(text, kind, sep=" ")
        except ValueError:  # NumPy 2.4 raises where it warned before
            return np.empty(0, kind)


def _text(data: bytes) -> str:
    return data.decode("utf-8", errors="replace").strip()
