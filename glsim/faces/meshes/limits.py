"""Formats and largest sizes of mesh files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from glsim.core.errors import MeshError
from glsim.core.files.regular import open_regular

EXTENSIONS: Final = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
"""Readable formats: OBJ by glsim, the others by trimesh without further packages."""

MAX_TRIANGLES: Final = 5_000_000
"""Largest number of triangles: a head in 0.3 mm triangles. More would need 0.4 GB of vertices for
detail that no depth camera sees."""

MAX_BYTES: Final = 200 * MAX_TRIANGLES
"""Largest file size, bytes: 200 per triangle; an OBJ with texture coordinates and normals needs
about 120."""


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
