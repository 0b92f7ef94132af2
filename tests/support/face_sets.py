"""Write small files in the formats of the face sets."""

import pickle
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.faces.face_source import Face, FaceKey, FaceSource
from tests.support.face_models import analytic_face

FACE, TRIANGLES = analytic_face(rows=31, columns=25)
ROWS, COLUMNS = 31, 25
#: Trees of another writer, if they are beside the repository.
OTHERS = Path(__file__).resolve().parents[3] / "shared" / "data" / "fixtures"
needs_others = pytest.mark.skipif(not OTHERS.is_dir(), reason=f"no trees in {OTHERS}")


def all_keys(source: FaceSource) -> list[FaceKey]:
    """Return the keys of all frames of all subjects."""
    return [key for subject in source.subjects(None) for key in source.frames(subject, None)]


def good_faces(source: FaceSource, keys: Sequence[FaceKey]) -> list[Face]:
    """Load faces; fail if a face cannot be loaded."""
    faces = list(source.load(keys))
    assert all(isinstance(face, Face) for face in faces), faces
    return [face for face in faces if isinstance(face, Face)]


def ply_bytes(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> bytes:
    """Encode a binary PLY as FLAME registrations do: float32 x y z, three indices per face."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), np.dtype([("count", "u1"), ("corner", "<i4", (3,))]))
    faces["count"], faces["corner"] = 3, triangles
    return head.encode() + points.astype("<f4").tobytes() + faces.tobytes()


def obj_bytes(points: NDArray[np.float64], polygons: NDArray[np.int64], tail: str = "") -> bytes:
    """Encode an OBJ; ``tail`` follows the vertex number of each corner ("/1/1")."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    lines += ["f " + " ".join(f"{corner + 1}{tail}" for corner in face) for face in polygons]
    return ("\n".join(lines) + "\n").encode()


def quads() -> NDArray[np.int64]:
    """Return (Q, 4) quads of the analytic face."""
    first = (np.arange(ROWS - 1)[:, None] * COLUMNS + np.arange(COLUMNS - 1)).ravel()
    return np.stack([first, first + 1, first + COLUMNS + 1, first + COLUMNS], axis=1)


def put(path: Path, data: bytes) -> Path:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def shape_bytes(shapes: NDArray[np.float64], expressions: int | None = None) -> bytes:
    """Encode a shape.bs of (K, V, 3) meshes, the neutral first."""
    count = len(shapes) - 1 if expressions is None else expressions
    head = np.array([count, shapes.shape[1], len(quads())], "<i4")
    return head.tobytes() + shapes.astype("<f4").tobytes()


def blend_shapes(unit_mm: float = 110.0) -> NDArray[np.float64]:
    """Return (47, V, 3) blend shapes: the analytic face, its jaw K / 2 mm open in shape K."""
    opened = [analytic_face(rows=ROWS, columns=COLUMNS, open_mm=k / 2)[0] for k in range(47)]
    return np.stack(opened) / unit_mm


def write_tester(root: Path, number: int = 1, poses: int = 3) -> Path:
    """Write a fake person of FaceWarehouse and return the folder."""
    shapes = blend_shapes()
    folder = root / f"Tester_{number}"
    put(folder / "Blendshape/shape.bs", shape_bytes(shapes))
    put(folder / "Blendshape/shape_0.obj", obj_bytes(shapes[0], quads(), "/1/1"))
    for pose in range(poses):
        put(folder / f"TrainingPose/pose_{pose}.obj", obj_bytes(shapes[10 * pose], quads(), "/1/1"))
        put(folder / f"TrainingPose/pose_{pose}.land", b"1\n0.5 0.5\n")
    return folder


def pose_text(turn: NDArray[np.float64], centre: tuple[float, float, float]) -> bytes:
    """Encode a pose file of Biwi: rows with a trailing space, an empty line, the centre."""
    rows = "".join(" ".join(f"{value:.7g}" for value in row) + " \n" for row in turn)
    return f"{rows}\n{' '.join(f'{value:g}' for value in centre)} \n".encode()


def depth_bytes(depth_mm: NDArray[np.uint16]) -> bytes:
    """Encode (H, W) depths as Biwi's depth.bin: run lengths of empty and full pixels."""
    flat = depth_mm.ravel().astype("<i2")
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flat > 0, [False]])))
    parts = [np.array(depth_mm.shape[::-1], "<i4").tobytes()]
    done = 0
    for start, stop in edges.reshape(-1, 2):
        parts += [np.array([start - done, stop - start], "<i4").tobytes()]
        parts += [flat[start:stop].tobytes()]
        done = stop
    if done < len(flat):
        parts.append(np.array([len(flat) - done, 0], "<i4").tobytes())
    return b"".join(parts)


CALIBRATION = (
    b"575.816 0 320 \n0 575.816 240 \n0 0 1 \n\n0 0 0 0 \n\n"
    b"1 0 0 \n0 1 0 \n0 0 1 \n\n0 0 0 \n\n640 480\n"
)


def write_recording(root: Path, number: int = 1, frames: int = 3) -> Path:
    """Write a fake recording of Biwi: template, calibration, head poses, flat depth images."""
    template = (FACE - [3, 12, 0]) * [1, -1, -1]
    put(root / f"{number:02d}.obj", obj_bytes(template, TRIANGLES, "//1"))
    folder = root / f"{number:02d}"
    put(folder / "depth.cal", CALIBRATION)
    put(folder / "rgb.cal", CALIBRATION.replace(b"575.816", b"517.679"))
    for frame in range(3, 3 + frames):
        angle = np.radians(10.0 * (frame - 3))
        turn = np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        )
        put(folder / f"frame_{frame:05d}_pose.txt", pose_text(turn, (30.0, -20.0, 900.0)))
        depth = np.zeros((480, 640), np.uint16)
        depth[100:400, 200:450] = 1000 + frame
        put(folder / f"frame_{frame:05d}_depth.bin", depth_bytes(depth))
    return root


def write_tree(name: str, root: Path) -> Path:
    """Write a small D3DFACS, FaceWarehouse or Biwi below ``root``; return its folder."""
    folder = root / name
    if name == "hpdb":
        return write_recording(folder, frames=1)
    if name == "FaceWarehouse":
        write_tester(folder, 1, poses=2)
        write_tester(folder, 2, poses=2)
        return folder
    for frame in (150, 151):  # registrations of FLAME: their numbers do not begin at 0
        points = analytic_face(rows=ROWS, columns=COLUMNS, open_mm=0.4 * (frame - 150))[0]
        put(folder / f"Joe/1+2/1+2_{frame}.ply", ply_bytes(points / 1000, TRIANGLES))
    return folder


def assert_keys_decide(
    source: FaceSource, keys: list[FaceKey], expected: list[Face] | None = None
) -> list[Face]:
    """Check that faces are the same together, alone, and backwards by a copy of the source.

    Return them; ``expected`` are those that another instance gave.
    """
    together = good_faces(source, keys)
    copy = pickle.loads(pickle.dumps(source))
    backwards = good_faces(copy, keys[::-1])[::-1]
    alone = [good_faces(copy, [key])[0] for key in reversed(keys)][::-1]
    every = (expected or together, together, backwards, alone)
    for key, first, *others in zip(keys, *every, strict=True):
        for face in (first, *others):
            assert face.key == key
            assert (face.expression, face.notes) == (first.expression, first.notes)
            np.testing.assert_array_equal(face.mesh.vertices_mm, first.mesh.vertices_mm)
            np.testing.assert_array_equal(face.mesh.albedo, first.mesh.albedo)
        assert others[0].mesh.faces is together[0].mesh.faces
    return together
