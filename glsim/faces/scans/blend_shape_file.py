"""Read FaceWarehouse's ``shape.bs``: the 47 meshes of a person in one file.

Little-endian: int32 number of expressions (46: the neutral face is not counted), int32 vertices,
int32 quads; then 47 times (vertices, 3) float32 positions, the neutral first. No faces, no names.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError

SHAPES: Final = 47
"""The neutral face and 46 expressions. A reader that takes 46 as the total loses the last one."""

_HEADER_BYTES: Final = 12
_MAX_VERTICES: Final = 1_000_000  # FaceWarehouse has 11,510; a shape of this many is 12 MB


@dataclass(frozen=True)
class BlendShapeFile:
    """A file with a checked header: it contains SHAPES meshes of ``vertices`` vertices."""

    path: Path
    vertices: int

    def read(self, numbers: Iterable[int]) -> list[NDArray[np.float32]]:
        """Read meshes by number (0: neutral), (V, 3) float32 each. Raises MeshError."""
        size = 12 * self.vertices
        meshes = []
        try:
            with self.path.open("rb") as file:
                for number in numbers:
                    file.seek(_HEADER_BYTES + number * size)
                    points = np.frombuffer(file.read(size), "<f4").reshape(self.vertices, 3)
                    if not np.isfinite(points).all():
                        raise MeshError(
                            f"{self.path}: shape {number} holds NaN or infinity; "
                            "the file is damaged, copy it again"
                        )
                    meshes.append(points)
        except (OSError, ValueError) as error:
            raise MeshError(f"{self.path}: cannot be read ({error}); copy it again") from None
        return meshes


def open_blend_shapes(path: Path) -> BlendShapeFile:
    """Check the header against the size of the file. Raises MeshError."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = np.frombuffer(file.read(_HEADER_BYTES), "<i4")
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValueError:
        head = np.empty(0, "<i4")
    if len(head) < 3:
        raise MeshError(f"{path}: cut short: {size} bytes hold no header; copy it again")
    expressions, vertices, _ = (int(number) for number in head)
    if expressions not in (SHAPES - 1, SHAPES) or not 3 <= vertices <= _MAX_VERTICES:
        raise MeshError(
            f"{path}: promises {expressions} expressions of {vertices} vertices, and should "
            f"{SHAPES - 1} of 3 to {_MAX_VERTICES}; the file is damaged, copy it again"
        )
    if size != _HEADER_BYTES + SHAPES * 12 * vertices:
        raise MeshError(
            f"{path}: {size} bytes hold {(size - _HEADER_BYTES) / (12 * vertices):.4g} meshes of "
            f"{vertices} vertices, not the neutral and {SHAPES - 1} expressions; copy it again"
        )
    return BlendShapeFile(path, vertices)
