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


def shape_bytes(shapes: NDArray[np.float64], expressions: int | None = None) -> bytes:
    """A shape.bs of (K, V, 3) meshes, the neutral first."""
    count = len(shapes) - 1 if expressions is None else expressions
    head = np.array([count, shapes.shape[1], len(quads())], "<i4")
    return head.tobytes() + shapes.astype("<f4").tobytes()


def blend_shapes(unit_mm: float = 110.0) -> NDArray[np.float64]:
    """(47, V, 3): the analytic face with a jaw that opens by K / 2 mm in shape K."""
    opened = [analytic_face(rows=ROWS, columns=COLUMNS, open_mm=k / 2)[0] for k in range(47)]
    return np.stack(opened) / unit_mm


def write_tester(root: Path, number: int = 1, poses: int = 3) -> Path:
    """A person of FaceWarehouse."""
    shapes = blend_shapes()
    folder = root / f"Tester_{number}"
    put(folder / "Blendshape/shape.bs", shape_bytes(shapes))
    put(folder / "Blendshape/shape_0.obj", obj_bytes(shapes[0], quads(), "/1/1"))
    for pose in range(poses):
        put(folder / f"TrainingPose/pose_{pose}.obj", obj_bytes(shapes[10 * pose], quads(), "/1/1"))
        put(folder / f"TrainingPose/pose_{pose}.land", b"1\n0.5 0.5\n")
    return folder
