"""Read the polygons of PLY and OFF files, in the file's own vertex order.

trimesh reads no binary PLY of mixed polygons, and splits hollow polygons into fans.
"""

from __future__ import annotations

import io
import re
from array import array
from contextlib import suppress
from itertools import islice
from pathlib import Path
from struct import Struct, calcsize, unpack_from
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.meshes import obj

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


class _Rows(NamedTuple):
    """The rows of an element.

    ``table``: a structured array; None if rows have lists of different lengths. ``corners``: the
    vertex indices of all rows, concatenated; ``counts``: how many each row has.
    """

    table: NDArray[Any] | None
    corners: NDArray[np.int64]
    counts: NDArray[np.int64]


#: Largest body, bytes for each row that the header promises, and besides: a row of 64 numbers, as
#: of a Gaussian splat, has 1.6 kB as text.
_ROW_BYTES, _MORE_BYTES = 2000, 1 << 24


def read_ply(path: Path) -> obj.PolygonFile:
    """Read an ASCII or binary PLY of either byte order: polygons or triangle strips.

    Raises MeshError, or the parser's error for a damaged file.
    """
    head = obj.check_start(path, rb"ply\s.*?end_header[ \t]*(\r\n|\n|\r)", "PLY (no end_header)")
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
    data = obj.read_bytes(path, _ROW_BYTES * rows + _MORE_BYTES)
    if encoding == "ascii":
        text = obj.plain_nan(data[len(head) :])
        body, parsed, place = obj.parse_numbers(text, "<f8").tobytes(), dict[str, _Rows](), -1
        with suppress(Exception):
            parsed, place = _elements(path, body, 0, elements)
        if place != len(body):
            body = _declared_numbers(path, text, head.count(b"\n"), elements)
            parsed, _ = _elements(path, body, 0, elements)
    else:
        parsed, _ = _elements(path, data, len(head), elements)
    nothing = _Rows(np.empty(0, [(axis, "f8") for axis in "xyz"]), *[np.empty(0, np.int64)] * 2)
    points = parsed.get("vertex", nothing).table
    if points is None:
        raise MeshError(f"{path}: its vertices have lists of several lengths; export it without")
    coloured = {"red", "green", "blue"} <= set(points.dtype.names or ())
    _, corners, counts = parsed.get("face", nothing)
    if "face" not in parsed and "tristrips" in parsed:
        corners = _strips(parsed["tristrips"].corners).ravel()
        counts = np.full(len(corners) // 3, 3)
    return obj.PolygonFile(
        _columns(points, ["x", "y", "z"]),
        _columns(points, ["red", "green", "blue"]) if coloured else None,
        corners,
        counts,
    ).checked(path)


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


def read_off(path: Path) -> obj.PolygonFile:
    """Read a text OFF, with the vertex colours of a COFF. Raises the errors of ``read_ply``."""
    gap = rb"(?:\s|#[^\n]*\n)"
    start = obj.check_start(path, gap + rb"*\w*OFF" + gap + rb"+\d+" + gap + rb"+\d+", "a text OFF")
    promised = sum(int(word) for word in start.split()[-2:])
    data = obj.read_bytes(path, _ROW_BYTES * promised + _MORE_BYTES)
    text = re.sub(rb"#.*", b"", obj.plain_nan(data)).lstrip()
    head = re.match(rb"(?:ST)?(C?)(N?)OFF(?!\s*BINARY)", text)
    if head is None:
        raise MeshError(f"{path}: damaged or no text OFF of 3D points; export it as PLY")
    lines = (line for line in io.BytesIO(text[head.end() :]) if line.strip())
    points, faces = (int(word) for word in next(lines, b"").split()[:2])
    rows = b"".join(islice(lines, min(points, len(text))))
    if not 0 < rows.count(b"\n") <= points <= len(text):
        raise MeshError(f"{path}: cut short: it has fewer lines than its header promises")
    table = obj.parse_rows(path, rows, range(3, 13))
    first = 6 if head[2] else 3  # behind the normals
    colours = table[:, first : first + 3] if table.shape[1] >= first + 3 else None
    corners, lengths = array("q"), array("q")
    for words in map(bytes.split, islice(lines, min(faces, len(text)))):
        lengths.append(int(words[0]))
        corners.extend(map(int, words[1 : lengths[-1] + 1]))
    counts = np.array(lengths, np.int64)
    if len(counts) < faces or len(corners) != counts.sum():
        raise MeshError(f"{path}: cut short: it has {len(counts)} faces of the {faces} it promises")
    colours = colours if head[1] else None
    vertices = table[:, :3].copy()
    return obj.PolygonFile(vertices, colours, np.array(corners, np.int64), counts).checked(path)


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
    lists = [name for name, types in properties if len(types) == 2]
    known = [name for name in lists if name in ("vertex_indices", "vertex_index")]
    chosen = (known or lists or [""])[0]
    kind, lengths = _row_type(body, place, properties)
    if place + count * kind.itemsize <= len(body):
        table = np.frombuffer(body, kind, count, place)
        if all((table[f"{name} length"] == length).all() for name, length in lengths.items()):
            corners = table[chosen].astype(np.int64).ravel() if lists else np.empty(0, np.int64)
            counts = np.full(count, lengths.get(chosen, 0))
            return _Rows(table, corners, counts), place + table.nbytes
    if not lists:
        raise ValueError("the file ends early")
    values, sizes = bytearray(), array("q")
    steps = [
        (name, Struct(types[0]), [calcsize(kind) for kind in types[1:]])
        for name, types in properties
    ]
    for _ in range(count):
        for name, first, each in steps:
            length = int(first.unpack_from(body, place)[0]) if each else 0
            start, place = place + first.size, place + first.size + sum(each) * length
            if length < 0 or place > len(body):
                raise ValueError("a list has no length, or the file ends early")
            if name == chosen:
                values += body[start:place]
                sizes.append(length)
    counts = np.array(sizes, np.int64)
    obj.check_count(path, int(np.maximum(counts - 2, 0).sum()))  # before their numbers take memory
    corners = np.frombuffer(values, dict(properties)[chosen][1]).astype(np.int64)
    return _Rows(None, corners, counts), place


def _row_type(
    body: bytes, place: int, properties: list[_Property]
) -> tuple[np.dtype[Any], dict[str, int]]:
    """Return NumPy's type of the row at byte ``place``, and the lengths of its lists."""
    fields: list[tuple[Any, ...]] = []
    lengths: dict[str, int] = {}
    for name, (first, *values) in properties:
        if values:
            lengths[name] = int(unpack_from(first, body, place)[0])
            fields += [(f"{name} length", first), (name, values[0], (lengths[name],))]
            place += calcsize(values[0]) * lengths[name]
        else:
            fields.append((name, first))
        place += calcsize(first)
    return np.dtype(fields), lengths


def _strips(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (F, 3) triangles of strips that end with -1; every second triangle is reversed."""
    number = np.arange(len(corners))
    start = np.maximum.accumulate(np.where(corners < 0, number + 1, 0))[: len(corners) - 2]
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    odd = (number[: len(corners) - 2] - start) % 2 == 1
    triangles[odd] = triangles[odd][:, ::-1]
    return triangles[(triangles >= 0).all(axis=1)]
