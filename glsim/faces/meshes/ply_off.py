"""Read the polygons of PLY and OFF files, in the file's own vertex order.

trimesh reads no binary PLY of mixed polygons, and splits hollow polygons into fans.
"""

from __future__ import annotations

import io
import re
from array import array
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from struct import Struct, calcsize, unpack_from
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.meshes.obj import (
    PolygonFile,
    check_corners,
    check_count,
    check_start,
    parse_numbers,
    parse_rows,
    plain_nan,
    read_bytes,
)

#: PLY's names of types, older and newer -> letter of struct and NumPy.
_TYPES: Final = (
    {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I"}
    | {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"}
    | {"int64": "q", "uint64": "Q", "float16": "e", "float32": "f", "float64": "d"}
    | {"float": "f", "double": "d"}
)

#: Name of a property, and its type; for a list, the types of its length and of its values.
_Property = tuple[str, list[str]]

#: Name, number of rows and properties of an element.
_Element = tuple[str, int, list[_Property]]
#: The rows of an element: a structured array if all rows have lists of the same lengths, else the
#: values of the list of vertices, concatenated, and its length in each row.
_Rows = NDArray[Any] | tuple[NDArray[np.int64], NDArray[np.int64]]

#: Largest body, bytes for each row that the header promises, and besides: a row of 64 numbers, as
#: of a Gaussian splat, has 1.6 kB as text.
_ROW_BYTES, _MORE_BYTES = 2000, 1 << 24


def read_ply(path: Path) -> PolygonFile:
    """Read an ASCII or binary PLY of either byte order: polygons or triangle strips.

    Raises MeshError, or the parser's error for a damaged file.
    """
    head = check_start(path, rb"ply\s.*?end_header[ \t]*(\r\n|\n|\r)", "PLY (no end_header)")
    elements, encoding = _header(head.decode("latin-1"))
    rows, size = sum(count for _, count, _ in elements), path.stat().st_size
    least = sum(
        count * sum(2 if encoding == "ascii" else calcsize(types[0]) for _, types in properties)
        for _, count, properties in elements
    )
    if least > size or any(count < 0 for _, count, _ in elements):
        raise MeshError(
            f"{path}: cut short: it has {size} bytes for the {rows} rows that its header promises"
        )
    data = read_bytes(path, _ROW_BYTES * rows + _MORE_BYTES)
    if encoding == "ascii":
        text = plain_nan(data[len(head) :])
        body, parsed, place = parse_numbers(text, "<f8").tobytes(), dict[str, _Rows](), -1
        with suppress(Exception):
            parsed, place = _elements(path, body, 0, elements)
        if place != len(body):
            body = _declared_numbers(path, text, head.count(b"\n"), elements)
            parsed, _ = _elements(path, body, 0, elements)
    else:
        parsed, _ = _elements(path, data, len(head), elements)
    points, colours = parsed.get("vertex"), None
    if isinstance(points, tuple):
        raise MeshError(f"{path}: its vertices have lists of several lengths; export it without")
    vertices = np.empty((0, 3)) if points is None else _columns(points, ["x", "y", "z"])
    if points is not None and {"red", "green", "blue"} <= set(points.dtype.names or ()):
        colours = _columns(points, ["red", "green", "blue"])
    corners, counts = np.empty(0, np.int64), np.empty(0, np.int64)
    if "face" in parsed:
        corners, counts = _lists(parsed["face"])
    elif "tristrips" in parsed:
        corners = _strips(_lists(parsed["tristrips"])[0]).ravel()
        counts = np.full(len(corners) // 3, 3)
    return _polygon_file(path, vertices, colours, corners, counts)


def _declared_numbers(path: Path, body: bytes, before: int, elements: list[_Element]) -> bytes:
    """Return the numbers of an ASCII body as float64, without those behind a row's declared ones.

    Line breaks mean nothing unless there are more numbers than declared, such as the colours that
    MeshLab writes behind a face: then each row is a line. Raises MeshError naming the line.
    """
    lines = enumerate(io.BytesIO(body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")), before + 1)
    rows = ((number, words) for number, line in lines if (words := line.split()))
    kept = array("d")
    for name, count, properties in elements:
        for _ in range(count):
            number, words = next(rows, (0, []))
            if not words:
                raise MeshError(f"{path}: cut short: it has fewer lines than its header promises")
            end = 0
            for _, types in properties:
                listed = len(types) == 2 and end < len(words)
                end += 1 + (int(words[end]) if listed else 0)
            if end > len(words):
                raise MeshError(
                    f"{path}: line {number}, of element {name!r}, has {len(words)} numbers and the "
                    f"header declares {end}: cut short or damaged; export it again"
                )
            kept.extend(map(float, words[:end]))
    return kept.tobytes()


def _header(text: str) -> tuple[list[_Element], str]:
    """Return name, number of rows and properties of each element of a PLY, and its encoding."""
    elements: list[_Element] = []
    encoding = ""
    for words in map(str.split, text.splitlines()):
        if words[:1] == ["format"]:
            encoding = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            order = ">" if "big" in encoding else "<"
            types = [order + _TYPES[word] for word in words[1:-1] if word != "list"]
            types = ["<d"] * len(types) if encoding == "ascii" else types
            elements[-1][2].append((words[-1], types))
    return [element for element in elements if element[2]], encoding  # others have no rows


def _columns(table: NDArray[Any], names: list[str]) -> NDArray[np.float64]:
    return np.stack([table[name] for name in names], axis=1).astype(np.float64)


def read_off(path: Path) -> PolygonFile:
    """Read a text OFF, with the vertex colours of a COFF. Raises the errors of ``read_ply``."""
    gap = rb"(?:\s|#[^\n]*\n)"
    start = check_start(path, gap + rb"*\w*OFF" + gap + rb"+\d+" + gap + rb"+\d+", "a text OFF")
    promised = sum(int(word) for word in start.split()[-2:])
    data = read_bytes(path, _ROW_BYTES * promised + _MORE_BYTES)
    text = re.sub(rb"#.*", b"", plain_nan(data)).lstrip()
    head = re.match(rb"(?:ST)?(C?)(N?)OFF(?!\s*BINARY)", text)
    if head is None:
        raise MeshError(f"{path}: damaged or no text OFF of 3D points; export it as PLY")
    lines = (line for line in io.BytesIO(text[head.end() :]) if line.strip())
    points, faces = (int(word) for word in next(lines, b"").split()[:2])
    rows = b"".join(islice(lines, min(points, len(text))))
    if not 0 < rows.count(b"\n") <= points <= len(text):
        raise MeshError(f"{path}: cut short: it has fewer lines than its header promises")
    table = parse_rows(path, rows, range(3, 13))
    first = 6 if head[2] else 3  # behind the normals
    colours = table[:, first : first + 3] if table.shape[1] >= first + 3 else None
    corners, lengths = array("q"), array("q")
    for words in map(bytes.split, islice(lines, min(faces, len(text)))):
        lengths.append(int(words[0]))
        corners.extend(map(int, words[1 : lengths[-1] + 1]))
    counts = np.array(lengths, np.int64)
    if len(counts) < faces or len(corners) != counts.sum():
        raise MeshError(f"{path}: cut short: it has {len(counts)} faces of the {faces} it promises")
    return _polygon_file(
        path, table[:, :3].copy(), colours if head[1] else None, np.array(corners, np.int64), counts
    )


def _polygon_file(
    path: Path,
    vertices: NDArray[np.float64],
    colours: NDArray[np.float64] | None,
    corners: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> PolygonFile:
    """Check the corners, and drop polygons that are points and lines."""
    check_corners(path, corners, len(vertices))
    area = counts > 2
    check_count(path, int((counts[area] - 2).sum()))
    if not area.all():
        corners, counts = corners[np.repeat(area, counts)], counts[area]
    return PolygonFile(vertices, colours, corners, counts)


def _elements(
    path: Path, body: bytes, place: int, elements: list[_Element]
) -> tuple[dict[str, _Rows], int]:
    """Return the rows of each element that has some, from byte ``place`` on, and their end."""
    parsed: dict[str, _Rows] = {}
    for name, count, properties in elements:
        if count:
            parsed[name], place = _read_rows(path, body, place, count, properties)
    return parsed, place


def _read_rows(
    path: Path, body: bytes, place: int, count: int, properties: list[_Property]
) -> tuple[_Rows, int]:
    """Return the rows of an element of a PLY, and its end."""
    kind, lengths = _row_type(body, place, properties)
    if place + count * kind.itemsize <= len(body):
        table = np.frombuffer(body, kind, count, place)
        if all((table[name] == length).all() for name, length in lengths):
            return table, place + table.nbytes
    if not lengths:
        raise ValueError("the file ends early")
    wanted = _list_of_vertices([name for name, types in properties if len(types) == 2])
    starts, sizes = array("q"), array("q")
    steps = [
        (name == wanted, Struct(types[0]).unpack_from, calcsize(types[0]), calcsize(types[-1]))
        for name, types in properties
    ]
    listed = [len(types) == 2 for _, types in properties]
    for _ in range(count):
        for (chosen, unpack, first, each), many in zip(steps, listed, strict=True):
            length = int(unpack(body, place)[0]) if many else 0
            place += first
            if chosen:
                starts.append(place)
                sizes.append(length)
            place += each * length
            if length < 0 or place > len(body):
                raise ValueError("a list has no length, or the file ends early")
    counts = np.array(sizes, np.int64)
    check_count(path, int(np.maximum(counts - 2, 0).sum()))
    values = np.dtype(dict(properties)[wanted][1])
    shifts = np.array(starts, np.int64) - values.itemsize * (np.cumsum(counts) - counts)
    places = np.repeat(shifts, counts) + values.itemsize * np.arange(counts.sum())
    every_byte = np.ndarray((len(body) - values.itemsize + 1,), values, body, 0, (1,))
    return (every_byte[places].astype(np.int64), counts), place


def _row_type(
    body: bytes, place: int, properties: list[_Property]
) -> tuple[np.dtype[Any], list[tuple[str, int]]]:
    """Return NumPy's type of the row at byte ``place``, and the lengths of its lists."""
    fields: list[tuple[Any, ...]] = []
    lengths: list[tuple[str, int]] = []
    for name, types in properties:
        if len(types) == 2:
            lengths.append((f"{name} length", int(unpack_from(types[0], body, place)[0])))
            fields.append((lengths[-1][0], types[0]))
            place += calcsize(types[0]) + calcsize(types[1]) * lengths[-1][1]
            fields.append((name, types[1], (lengths[-1][1],)))
        else:
            place += calcsize(types[0])
            fields.append((name, types[0]))
    return np.dtype(fields), lengths


def _list_of_vertices(lists: Sequence[str]) -> str:
    return next((name for name in lists if name in ("vertex_indices", "vertex_index")), lists[0])


def _lists(rows: _Rows) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the vertex indices of all rows, concatenated, and their number in each row."""
    if isinstance(rows, tuple):
        return rows
    names = rows.dtype.names or ()
    table = rows[_list_of_vertices([name for name in names if f"{name} length" in names])]
    return table.astype(np.int64).ravel(), np.full(len(table), table.shape[1])


def _strips(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (F, 3) triangles of strips that end with -1; every second triangle is reversed."""
    number = np.arange(len(corners))
    start = np.maximum.accumulate(np.where(corners < 0, number + 1, 0))[: len(corners) - 2]
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    odd = (number[: len(corners) - 2] - start) % 2 == 1
    triangles[odd] = triangles[odd][:, ::-1]
    return triangles[(triangles >= 0).all(axis=1)]
