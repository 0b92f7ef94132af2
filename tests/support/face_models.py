"""Faces for tests: an analytic head, a FaceXModel folder in ICT-FaceKit's layout, a board."""

import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import Mesh
from glsim.data.dataset_run import write_dataset
from glsim.faces.face_source import Face, FaceKey, FaceSource, Topology
from glsim.faces.regions import region_numbers
from glsim.faces.sources.ict_facekit import KNOWN_SHAPES, REGIONS
from glsim.settings.schema import Settings
from glsim.simulation.pipeline import simulate
from glsim.simulation.plan.tasks import make_tasks

ROWS, COLUMNS = 61, 49


def analytic_face(
    *, rows: int = ROWS, columns: int = COLUMNS, open_mm: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (V, 3), mm, and triangles (F, 3) of a head's front, in canonical axes.

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
    """Write a FaceXModel folder of the analytic face: same files and JSON keys, centimetres.

    ``drawn.npz`` beside it says that all of it is drawn, its upper half as "forehead".
    """
    folder.mkdir(parents=True)
    face, triangles = analytic_face(rows=21, columns=17)
    neutral = face / 10
    tail = "".join(f"f {a} {b} {c}\n" for a, b, c in triangles + 1)
    expressions = sorted(KNOWN_SHAPES)
    (folder / "vertex_indices.json").write_text(json.dumps({"expressions": expressions}))
    (folder / "generic_neutral_mesh.obj").write_text(_vertex_lines(neutral) + tail)
    rng = np.random.default_rng(0)
    for mode in range(100):
        moved = neutral + rng.normal(size=3) * 0.3 / (mode + 1)
        (folder / f"identity{mode:03d}.obj").write_text(_vertex_lines(moved))
    for name in expressions:
        moved = neutral.copy()
        if name == "jawOpen":
            moved[neutral[:, 1] < -3, 1] -= 4.0
        else:
            moved[:, 2] += 0.1
        (folder / f"{name}.obj").write_text(_vertex_lines(moved))
    np.savez(
        folder.parent / "drawn.npz",
        size=[len(neutral), len(triangles)],
        vertices=np.arange(len(neutral))[::-1],
        triangles=np.arange(len(triangles)),
        regions=np.where(neutral[::-1, 1] > 1.2, REGIONS.index("forehead"), 0).astype(np.uint8),
        landmarks=np.arange(68),
    )
    return folder


def _vertex_lines(vertices: NDArray[np.float64]) -> str:
    return "".join(f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in vertices)


class Board(FaceSource):
    """A source of two squares side by side, 60 mm each, with the regions "nose" and "tail"."""

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


def write_simulated(
    out: Path, settings: Settings, sources: Sequence[FaceSource], workers: int = 1
) -> None:
    """Write a data set of simulated frames, with its regions if they are a layer."""
    layers = settings.output.layers
    write_dataset(
        settings,
        make_tasks(settings, sources),
        out,
        partial(simulate, sources=sources, layers=layers),
        sensor={"title": "t"},
        renderer="r",
        regions=region_numbers(sources) if "regions" in layers else None,
        workers=workers,
    )
