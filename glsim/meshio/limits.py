"""Limits on mesh files: formats, sizes and counts checked before a mesh is read."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import IO, Final

from glsim.errors import MeshError, did_you_mean
from glsim.files.regular import open_regular

EXTENSIONS: Final = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
"""Readable formats: OBJ and plain PLY by glsim, the others by trimesh without further packages."""

MAX_TRIANGLES: Final = 5_000_000
"""Largest number of triangles: a head in 0.3 mm triangles. More would need 0.4 GB of vertices for
detail that no depth camera sees."""

MAX_BYTES: Final = 200 * MAX_TRIANGLES
"""Largest file size, bytes: 200 per triangle; an OBJ with texture coordinates and normals needs
about 120."""

MAX_LINES: Final = 4 * MAX_TRIANGLES
"""Most lines of a text file: a mesh of this many triangles has half as many vertices, texture
coordinates and normals each; empty lines take time, too."""

_HEAD_BYTES: Final = 1 << 16


def check_size(path: Path, max_bytes: int) -> int:
    """Return a file's size in bytes. Raises MeshError if it is 0 or above ``max_bytes``."""
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
    return size


def check_file(path: Path) -> int:
    """Check a mesh file by its name, size and header; return the number of faces to expect.

    The number is a lower bound: 0 for formats whose reader checks it. Raises MeshError.
    """
    if path.is_dir():
        raise MeshError(f"{path}: is a directory, not a mesh; the source 'folder' reads trees")
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    suffix = path.suffix.lower()
    if suffix not in EXTENSIONS:
        raise MeshError(
            f"{path}: {suffix or 'a file without extension'} is not a mesh format glsim reads "
            f"({did_you_mean(suffix, EXTENSIONS)}); export it as OBJ or PLY"
        )
    if size == 0:
        raise MeshError(f"{path}: the file is empty")
    if size > MAX_BYTES:
        raise MeshError(
            f"{path}: {size / 1e9:.1f} GB is more than a mesh of {MAX_TRIANGLES} triangles needs; "
            "simplify it (a depth camera sees 2.5 mm at 0.9 m)"
        )
    counts = _declared_counts(path, suffix, size)
    for count in counts:
        check_count(path, count)
    return counts[1] if suffix == ".off" and counts else 0  # the other readers count themselves


def _declared_counts(path: Path, suffix: str, size: int) -> list[int]:
    """Return the element counts a file declares, to reject a huge one before it fills memory."""
    try:
        with open_regular(path) as file:
            head = file.read(_HEAD_BYTES)
            if suffix == ".obj" and size > MAX_TRIANGLES:
                return _obj_counts(path, file)
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    if suffix == ".ply":
        if head.startswith(b"ply") and b"end_header" not in head and size > _HEAD_BYTES:
            raise MeshError(f"{path}: its header has no end; the file is damaged, export it again")
        return [int(count) for count in re.findall(rb"element \w+ +(\d{1,18})", head)]
    if suffix == ".off":
        first = re.search(rb"^\s*(?:[A-Z]*OFF)?\s*(\d{1,18})\s+(\d{1,18})", head)
        return [int(count) for count in first.groups()] if first else []
    if suffix == ".stl" and not head.lstrip().startswith(b"solid") and len(head) >= 84:
        count = int.from_bytes(head[80:84], "little")
        if size < 84 + 50 * count:
            raise MeshError(
                f"{path}: cut short: {count} triangles need {84 + 50 * count} bytes, "
                f"there are {size}; copy or export it again"
            )
        return [count]
    return []


def _obj_counts(path: Path, file: IO[bytes]) -> list[int]:
    """Count the vertices and polygons of an OBJ by blocks. Raises MeshError for too many lines."""
    file.seek(0)
    lines = vertices = polygons = 0
    while block := file.read(1 << 24):
        lines += block.count(b"\n")
        vertices += block.count(b"\nv ")
        polygons += block.count(b"\nf ")
        if lines > MAX_LINES:
            raise MeshError(
                f"{path}: more than {MAX_LINES} lines, which no mesh of {MAX_TRIANGLES} triangles "
                "needs; export it again"
            )
    return [polygons, vertices]


def check_count(path: Path, triangles: int) -> None:
    """Raise MeshError for more than MAX_TRIANGLES triangles."""
    if triangles > MAX_TRIANGLES:
        raise MeshError(
            f"{path}: {triangles} triangles or vertices, the limit is {MAX_TRIANGLES}; "
            "simplify it (a depth camera sees 2.5 mm at 0.9 m)"
        )
