"""Faces for tests: an analytic head, a FaceXModel folder in ICT-FaceKit's layout, a board."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.faces.base import Face, FaceKey, FaceSource, Topology
from glsim.faces.ict_facekit.model import KNOWN_SHAPES

ROWS, COLUMNS = 61, 49


def analytic_face(
    *, rows: int = ROWS, columns: int = COLUMNS, open_mm: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (V, 3), mm, and triangles (F, 3) of the front of a head, in canonical axes.

    144 mm wide, 215 mm high, with a nose of 20 mm and its tip at (3, 12, 60); the left cheek is
    2 mm fuller than the right. ``open_mm`` lowers the jaw.
    """
    x, y = np.meshgrid(np.linspace(-72, 72, columns), np.linspace(-110, 105, rows))
    z = 40 - x**2 / (2 * 80) - y**2 / (2 * 220)
    ridge = np.interp(y, [-18, -8, 0, 12, 26, 42], [0, 12, 20, 17, 10, 0])
    width = np.interp(y, [-18, 0, 15, 40], [14, 12, 9, 8])
    z += ridge * np.exp(-((np.abs(x) / width) ** 3))
    for side in (-1, 1):
        z -= 12 * np.exp(-(((x - side * 23) / 12) ** 2) - ((y - 30) / 16) ** 2)  # eye hollows
    z += 5 * np.exp(-((x / 24) ** 2) - ((y + 32) / 7) ** 2)  # lips
    z += 4 * np.exp(-((x / 18) ** 2) - ((y + 70) / 14) ** 2)  # chin
    z += 2 * np.exp(-(((x - 40) / 15) ** 2) - ((y + 5) / 20) ** 2)  # the fuller cheek
    y = y - open_mm * np.clip((-32 - y) / 40, 0, 1)
    vertices = np.stack([x + 3, y + 12, z], axis=-1).reshape(-1, 3)
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, up = first + 1, first + columns
    faces = np.concatenate(
        [np.stack([first, right, up], axis=1), np.stack([right, up + 1, up], axis=1)]
    )
    return vertices, faces


def write_face_x_model(folder: Path) -> Path:
    """Write a FaceXModel folder: same files, materials and JSON keys, few vertices, centimetres.

    Each connected part is a grid of quads; the parts of M_BackHead touch only M_Face.
    """
    folder.mkdir(parents=True)
    face, _ = analytic_face(rows=21, columns=17)
    parts: list[tuple[str, NDArray[np.float64], int]] = [("M_Face", face / 10, 17)]
    parts += [
        ("M_BackHead", _patch((0, 0, -8), 12, 15), 4),  # back of the head
        ("M_BackHead", _patch((0, -2, 0), 3, 2), 4),  # mouth socket
        ("M_BackHead", _patch((3.1, 4, 2), 2, 2), 4),
        ("M_BackHead", _patch((-3.1, 4, 2), 2, 2), 4),
        ("M_GumsTongue", _patch((0, -2, 1), 3, 2), 4),
        ("M_Teeth", _patch((0, -2, 1.5), 3, 1), 4),
    ]
    for side, x in (("Left", 3.1), ("Right", -3.1)):
        parts.append((f"M_Sclera{side}", _ball((x, 4.0, 1.0), 1.2, 10), 10))
        parts.append((f"M_Iris{side}", _patch((x, 4.0, 2.1), 0.9, 0.9), 4))
    parts.append(("M_LacrimalFluid", _patch((3, 4, 2.3), 0.5, 0.5), 4))
    parts.append(("M_EyeLashes", _patch((3, 4.5, 2.3), 0.5, 0.5), 4))

    neutral = np.concatenate([points for _, points, _ in parts])
    lines: list[str] = ["# a comment", "mtllib ICTFaceModelMaterial.mtl"]
    start, material = 1, ""
    for name, points, columns in parts:
        if name != material:
            lines.append(f"usemtl {name}")
            material = name
        for row in range(len(points) // columns - 1):
            for column in range(columns - 1):
                a = start + row * columns + column
                corners = (a, a + 1, a + columns + 1, a + columns)
                lines.append("f " + " ".join(f"{c}/{c}" for c in corners))
        start += len(points)
    tail = "\n".join(lines) + "\n"
    front = parts[0][1]
    landmarks = [
        int(np.argmin(np.linalg.norm(front[:, :2] - point, axis=1))) for point in _multi_pie()
    ]
    expressions = sorted(KNOWN_SHAPES)
    (folder / "vertex_indices.json").write_text(
        json.dumps({"expressions": expressions, "idx_to_landmark_verts": landmarks})
    )
    (folder / "generic_neutral_mesh.obj").write_text(_vertex_lines(neutral) + tail)
    rng = np.random.default_rng(0)
    for mode in range(100):
        moved = neutral + rng.normal(size=3) * 0.3 / (mode + 1)
        (folder / f"identity{mode:03d}.obj").write_text(_vertex_lines(moved) + tail)
    for name in expressions:
        moved = neutral.copy()
        if name == "jawOpen":
            moved[neutral[:, 1] < -3, 1] -= 4.0
        elif name.endswith("_L"):
            moved[neutral[:, 0] > 1, 2] += 0.2
        elif name.endswith("_R"):
            moved[neutral[:, 0] < -1, 2] += 0.2
        else:
            moved[:, 2] += 0.1
        (folder / f"{name}.obj").write_text(_vertex_lines(moved) + tail)
    return folder


def _multi_pie() -> NDArray[np.float64]:
    """Return (68, 2) landmarks of the analytic face, cm; its middle is at (0.3, 1.2)."""
    points = np.zeros((68, 2))
    jaw = np.linspace(-1, 1, 17)
    points[:17] = np.stack([6.5 * jaw, -9 + 12 * jaw**2], axis=1)
    points[17:22, 0], points[22:27, 0] = np.linspace(-5, -1, 5), np.linspace(1, 5, 5)
    points[17:27, 1] = 5.5
    points[27:31, 1] = (4, 3, 2, 0.5)
    points[31:36, 0], points[31:36, 1] = np.linspace(-1, 1, 5), -1.5
    ring = np.arange(6) * np.pi / 3
    for first, side in ((36, -1), (42, 1)):
        eye = [2.3 * side - 1.5 * np.cos(ring), 3.0 + 0.9 * np.sin(ring)]
        points[first : first + 6] = np.stack(eye, axis=1)
    angle = np.arange(12) * np.pi / 6
    points[48:60] = np.stack([2.4 * np.cos(angle), -3.2 - 1.2 * np.sin(angle)], axis=1)
    return np.asarray(points + np.array([0.3, 1.2]))


def _vertex_lines(vertices: NDArray[np.float64]) -> str:
    return "".join(f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in vertices)


def _patch(middle: tuple[float, float, float], width: float, height: float) -> NDArray[np.float64]:
    """Return (16, 3) points of a four by four grid facing +z."""
    x, y = np.meshgrid(np.linspace(-width, width, 4) / 2, np.linspace(-height, height, 4) / 2)
    z = -0.05 * (x**2 + y**2)
    return np.asarray(np.stack([x, y, z], axis=-1).reshape(-1, 3) + np.array(middle))


def _ball(middle: tuple[float, float, float], radius: float, columns: int) -> NDArray[np.float64]:
    """Return the rings of a sphere about the z axis, from the front."""
    polar, around = np.meshgrid(
        np.linspace(0.05, np.pi - 0.05, 9), np.linspace(0, 2 * np.pi, columns), indexing="ij"
    )
    ring = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1
    )
    return np.asarray(radius * ring.reshape(-1, 3) + np.array(middle))


class Board(FaceSource):
    """Two squares side by side, 60 mm each: the left in the image is "nose", the right "tail"."""

    name = "board"

    def __init__(self, wrong: bool = False) -> None:
        x, y = np.meshgrid([-60, -0.01, 0.01, 60], [-30, 30])
        points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
        corner = np.array([[0, 1, 5], [0, 5, 4], [2, 3, 7], [2, 7, 6]], np.int32)
        self._mesh = Mesh(points.astype(np.float32), corner)
        regions = np.array([1, 1, 0, 0] * (1 if wrong else 2), np.uint8)
        self._topology = Topology(corner, regions, ("tail", "nose"))

    @property
    def topology(self) -> Topology:
        return self._topology

    def subjects(self, count: int | None) -> list[str]:
        return ["b"]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [FaceKey("b", "s", number) for number in range(count or 1)]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        for key in keys:
            yield Face(key, self._mesh)
