"""Write whole trees of D3DFACS, FaceWarehouse and Biwi, in the style of the real files.

The layouts and formats are the real sets' (docs/face_data.md), the head is the analytic one. What
the tests of single readers write is plainer: no texture coordinates, line ends of Unix.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.support.face_models import analytic_face
from tests.support.face_sets import blend_shapes, depth_bytes, pose_text, put, quads, shape_bytes

GRID = 21
COLOUR_FOCAL_PX = 517.679  # of Biwi's colour camera
DEPTH_FOCAL_PX = 575.816


#: Trees of another writer, if they are beside the repository.
OTHERS = Path(__file__).resolve().parents[3] / "shared" / "data" / "fixtures"
#: Who wrote the trees that tests read: always this module, and the other writer if there is one.
WRITERS = ("ours", *(["another"] if OTHERS.is_dir() else []))


def tree(name: str, writer: str, folder: Path) -> Path:
    """Return the folder of a face set; the set of the writer "ours" is written below ``folder``."""
    return OTHERS / name if writer == "another" else write_tree(name, folder)


def write_tree(name: str, root: Path) -> Path:
    """Write a fake face set below ``root`` and return its folder."""
    writers = {"d3dfacs_alignments": _d3dfacs, "FaceWarehouse": _facewarehouse, "hpdb": _biwi}
    writers[name](root / name)
    return root / name


def _d3dfacs(root: Path) -> None:
    """Write two registrations as of FLAME: metres, float32, 60 frames/s, numbers not from 0."""
    for frame in (150, 151):
        points, triangles = analytic_face(rows=GRID, columns=GRID, open_mm=0.4 * (frame - 150))
        vertices = np.empty(len(points), [("p", "<f4", (3,)), ("n", "<f4", (3,))])
        vertices["p"], vertices["n"] = points / 1000, (0, 0, 1)
        faces = np.empty(len(triangles), [("count", "u1"), ("corner", "<i4", (3,))])
        faces["count"], faces["corner"] = 3, triangles
        lines = ["ply", "format binary_little_endian 1.0", "comment registration"]
        lines += [f"element vertex {len(points)}"]
        lines += [f"property float {axis}" for axis in ("x", "y", "z", "nx", "ny", "nz")]
        lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
        head = "\n".join([*lines, "end_header"]) + "\n"
        data = head.encode() + vertices.tobytes() + faces.tobytes()
        put(root / "Joe" / "1+2" / f"1+2_{frame}.ply", data)


def _facewarehouse(root: Path) -> None:
    """Write two people: 47 shapes in shape.bs, three poses as OBJ, 74 landmarks."""
    for number in (1, 2):
        shapes = blend_shapes(unit_mm=104.0 + 6 * number)
        folder = root / f"Tester_{number}"
        put(folder / "Blendshape" / "shape.bs", shape_bytes(shapes))
        put(folder / "Blendshape" / "shape_0.obj", _maya_obj(shapes[0], quads()))
        for pose in (0, 1):
            put(folder / "TrainingPose" / f"pose_{pose}.obj", _maya_obj(shapes[9 * pose], quads()))
            marks = "\r\n".join(f"{0.3 + 0.005 * n:g} {0.4:g}" for n in range(74))
            put(folder / "TrainingPose" / f"pose_{pose}.land", f"74\r\n{marks}\r\n".encode())


def _maya_obj(points: NDArray[np.float64], polygons: NDArray[np.int64]) -> bytes:
    """Encode an OBJ as modelling programs do: comments, groups, texture coordinates, CR LF."""
    lines = ["# exported", "mtllib default.mtl", "g default"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    lines += ["vt 0.000000 0.000000", "vn 0.000000 0.000000 1.000000", "s 1", "g face"]
    lines += ["f " + " ".join(f"{corner + 1}/1/1" for corner in face) for face in polygons]
    return ("\r\n".join(lines) + "\r\n").encode()


def _biwi(root: Path) -> None:
    """Write one frame of one recording: a template in camera axes, and depth at its pose."""
    points, triangles = analytic_face(rows=GRID, columns=GRID)
    template = (points - [3, 12, 0]) * [1, -1, -1]
    put(root / "01.obj", _maya_obj(template, triangles))
    for camera, focal_px in (("depth", DEPTH_FOCAL_PX), ("rgb", COLOUR_FOCAL_PX)):
        text = f"{focal_px:g} 0 320 \n0 {focal_px:g} 240 \n0 0 1 \n\n0 0 0 0 \n\n"
        text += "1 0 0 \n0 1 0 \n0 0 1 \n\n0 0 0 \n\n640 480\n"
        put(root / "01" / f"{camera}.cal", text.encode())
    angle = np.radians(12.0)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    centre_mm = (120.0, 40.0, 880.0)
    put(root / "01" / "frame_00003_pose.txt", pose_text(turn, centre_mm))
    seen = template @ turn.T + centre_mm
    columns, rows = (
        np.rint(DEPTH_FOCAL_PX * seen[:, axis] / seen[:, 2] + middle).astype(int)
        for axis, middle in ((0, 320), (1, 240))
    )
    depth_mm = np.zeros((480, 640), np.uint16)
    for row, column, distance in zip(rows, columns, seen[:, 2], strict=True):
        depth_mm[row - 4 : row + 5, column - 4 : column + 5] = round(distance)
    put(root / "01" / "frame_00003_depth.bin", depth_bytes(depth_mm))
