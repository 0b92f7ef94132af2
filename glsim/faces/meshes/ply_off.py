"""Read the polygons of PLY and OFF files, in the file's own vertex order.

trimesh reads no binary PLY of mixed polygons, and splits hollow polygons into fans.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from struct import calcsize, unpack_from
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError
from glsim.faces.meshes.obj import (
    PolygonFile,
    check_corners,
    check_count,
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

#: Numbers of rows and a structured array, for each set of lengths of lists.
_Groups = list[tuple[NDArray[np.int64], NDArray[Any]]]


def read_ply(path: Path) -> PolygonFile:
    """Read an ASCII or binary PLY of either byte order: polygons or triangle strips.

    Raises MeshError, or the parser's error for a damaged file.
    """
    data = read_bytes(path)
    head = re.match(rb"ply\s.*?end_header[ \t]*(\r\n|\n|\r)", data, re.DOTALL)
    if head is None:
        raise MeshError(f"{path}: damaged, cut short or not PLY (no end_header); export it again")
    elements, encoding = _header(head[0].decode("latin-1"))
    body = data[head.end() :]
    if encoding == "ascii":
        body = _declared_numbers(path, plain_nan(body), data.count(b"\n", 0, head.end()), elements)
    vertices, colours = np.empty((0, 3)), None
    corners, counts = np.empty(0, np.int64), np.empty(0, np.int64)
    place = 0
    for element, count, properties in elements:
        groups, place = _read_rows(body, place, count, properties)
        if element == "vertex" and groups:
            vertices = _columns(groups, count, ["x", "y", "z"])
            if {"red", "green", "blue"} <= {name for name, _ in properties}:
                colours = _columns(groups, count, ["red", "green", "blue"])
        elif element == "face":
            corners, counts = _lists(groups, count, properties)
        elif element == "tristrips":
            corners = _strips(_lists(groups, count, properties)[0]).ravel()
            counts = np.full(len(corners) // 3, 3)
    return _polygon_file(path, vertices, colours, corners, counts)


def _declared_numbers(
    path: Path, body: bytes, before: int, elements: list[tuple[str, int, list[_Property]]]
) -> bytes:
    """Return the numbers of an ASCII body as float64, without those behind a row's declared ones.

    Line breaks mean nothing unless there are more numbers than declared, such as the colours that
    MeshLab writes behind a face: then each row is a line. Raises MeshError naming the line.
    """
    numbers = np.array(body.split(), dtype="<f8").tobytes()
    with suppress(Exception):
        place = 0
        for _, count, properties in elements:
            _, place = _read_rows(numbers, place, count, properties)
        if place == len(numbers):
            return numbers
    lines = enumerate(body.splitlines(), before + 1)
    rows = iter([(number, words) for number, line in lines if (words := line.split())])
    kept: list[bytes] = []
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
            kept += words[:end]
    return np.array(kept, dtype="<f8").tobytes()


def _header(text: str) -> tuple[list[tuple[str, int, list[_Property]]], str]:
    """Return name, number of rows and properties of each element of a PLY, and its encoding."""
    elements: list[tuple[str, int, list[_Property]]] = []
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
    return elements, encoding


def _columns(groups: _Groups, count: int, names: list[str]) -> NDArray[np.float64]:
    columns = np.empty((count, len(names)))
    for rows, table in groups:
        columns[rows] = np.stack([table[name] for name in names], axis=1)
    return columns


def read_off(path: Path) -> PolygonFile:
    """Read a text OFF, with the vertex colours of a COFF. Raises the errors of ``read_ply``."""
    text = re.sub(rb"#.*", b"", plain_nan(read_bytes(path))).lstrip()
    head = re.match(rb"(?:ST)?(C?)(N?)OFF(?!\s*BINARY)", text)
    if head is None:
        raise MeshError(f"{path}: damaged or no text OFF of 3D points; export it as PLY")
    lines = [line for line in text[head.end() :].splitlines() if line.strip()]
    points, faces = (int(word) for word in lines[0].split()[:2])
    table = parse_rows(path, lines[1 : points + 1], range(3, 13))
    colours = table[:, 6:9] if head[2] else table[:, 3:6]  # behind the normals
    words = [line.split() for line in lines[points + 1 : points + 1 + faces]]
    counts = np.array([int(line[0]) for line in words], dtype=np.int64)
    flat = [word for line, count in zip(words, counts, strict=True) for word in line[1 : count + 1]]
    corners = np.array(flat, dtype=np.int64)
    if len(counts) < faces or len(corners) != counts.sum():
        raise MeshError(f"{path}: cut short: it has {len(counts)} faces of the {faces} it promises")
    return _polygon_file(path, table[:, :3].copy(), colours if head[1] else None, corners, counts)


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
    return PolygonFile(vertices, colours, corners[np.repeat(area, counts)], counts[area])


def _read_rows(
    body: bytes, place: int, count: int, properties: list[_Property]
) -> tuple[_Groups, int]:
    """Return the rows of an element of a PLY, and its end."""
    if not count:
        return [], place
    kind, lengths = _row_type(body, place, properties)
    if place + count * kind.itemsize <= len(body):
        table = np.frombuffer(body, kind, count, place)
        if all((table[name] == length).all() for name, length in lengths):
            return [(np.arange(count), table)], place + table.nbytes
    if not lengths:
        raise ValueError("the file ends early")
    groups: dict[np.dtype[Any], list[tuple[int, int]]] = {}
    for row in range(count):
        kind, _ = _row_type(body, place, properties)
        groups.setdefault(kind, []).append((row, place))
        place += kind.itemsize
    raw, tables = np.frombuffer(body, np.uint8), []
    for kind, members in groups.items():
        rows, places = np.array(members).T
        table = raw[places[:, None] + np.arange(kind.itemsize)].view(kind)
        tables.append((rows, table[:, 0]))
    return tables, place


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


def _lists(
    groups: _Groups, count: int, properties: list[_Property]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the vertex indices of all rows, concatenated, and their number in each row."""
    lists = [name for name, types in properties if len(types) == 2]
    name = next((name for name in lists if name in ("vertex_indices", "vertex_index")), lists[0])
    counts = np.zeros(count, np.int64)
    for rows, table in groups:
        counts[rows] = table[name].shape[1]
    corners = np.empty(counts.sum(), np.int64)
    starts = np.cumsum(counts) - counts
    for rows, table in groups:
        corners[starts[rows][:, None] + np.arange(table[name].shape[1])] = table[name]
    return corners, counts


def _strips(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (F, 3) triangles of strips that end with -1; every second triangle is reversed."""
    number = np.arange(len(corners))
    start = np.maximum.accumulate(np.where(corners < 0, number + 1, 0))[: len(corners) - 2]
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    odd = (number[: len(corners) - 2] - start) % 2 == 1
    triangles[odd] = triangles[odd][:, ::-1]
    return triangles[(triangles >= 0).all(axis=1)]
