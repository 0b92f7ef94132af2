"""Small writers of the face sets' formats, and where the fixtures of another writer may lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from facemodels import analytic_face
from numpy.typing import NDArray

FACE, TRIANGLES = analytic_face(rows=31, columns=25)
ROWS, COLUMNS = 31, 25
FIXTURES = Path(__file__).resolve().parents[2] / "shared" / "data" / "fixtures"


def fixture(*parts: str) -> Path:
    """A folder of the fixtures; the test is skipped where they are not."""
    path = FIXTURES.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path} is not there")
    return path


def ply_bytes(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> bytes:
    """A binary PLY as FLAME registrations have it: float32 x y z, three indices a face."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), np.dtype([("count", "u1"), ("corner", "<i4", (3,))]))
    faces["count"], faces["corner"] = 3, triangles
    return head.encode() + points.astype("<f4").tobytes() + faces.tobytes()


def obj_bytes(points: NDArray[np.float64], polygons: NDArray[np.int64], tail: str = "") -> bytes:
    """An OBJ; ``tail`` follows each corner's number ("/1/1")."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    lines += ["f " + " ".join(f"{corner + 1}{tail}" for corner in face) for face in polygons]
    return ("\n".join(lines) + "\n").encode()


def quads() -> NDArray[np.int64]:
    """The analytic face as quads."""
    first = (np.arange(ROWS - 1)[:, None] * COLUMNS + np.arange(COLUMNS - 1)).ravel()
    return np.stack([first, first + 1, first + COLUMNS + 1, first + COLUMNS], axis=1)


def put(path: Path, data: bytes) -> Path:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path
