"""Reading speed of face sets, and its effect on the rate of rendering.

    python -m benchmarks.sources [--frames 1200] [--workers 2] [--no-render]

Files of the sets' true sizes are made of one analytic face: FLAME's 5,023 vertices, FaceWarehouse's
11,510, Biwi's 6,918, raw D3DFACS's 30,000. The second table compares ``glsim generate`` with these
files and with the same meshes in memory.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from glsim.faces import open_source
from glsim.faces.base import Face, FaceKey, FaceSource
from glsim.settings.schema import Settings, load_settings
from glsim.settings.source_settings import SourceSettings, parse_source

SENSOR = "kinect-v2-paper"


class InMemory:
    """A face source that holds all faces of another one in memory."""

    def __init__(self, source: FaceSource, keys: Sequence[FaceKey]) -> None:
        self.name = source.name
        self._faces = {
            (face.key.subject, face.key.sequence, face.key.frame): face
            for face in source.load(keys)
            if isinstance(face, Face)
        }

    def subjects(self, count: int | None) -> list[str]:
        return list(dict.fromkeys(subject for subject, _, _ in self._faces))[:count]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        keys = [face.key for face in self._faces.values() if face.key.subject == subject]
        return keys[:count]

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
        for key in keys:
            yield self._faces[key.subject, key.sequence, key.frame]


def _grid(rows: int, columns: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices, (rows * columns, 3), and quads of an analytic face."""
    from tests.support.face_models import analytic_face

    points, _ = analytic_face(rows=rows, columns=columns)
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return points, np.stack([first, first + 1, first + columns + 1, first + columns], axis=1)


def _triangles(quads: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _registrations(root: Path, frames: int) -> dict[str, object]:
    from tests.support.face_sets import ply_bytes, put

    points, quads = _grid(79, 64)
    for number in range(frames):
        data = ply_bytes(points * (1 + 1e-4 * (number % 50)) / 1000, _triangles(quads))
        put(root / f"P{number % 8}/1+2/1+2_{number // 8}.ply", data)
    return {"kind": "d3dfacs", "root": root}


def _raw(root: Path, frames: int) -> dict[str, object]:
    from tests.support.face_sets import obj_bytes, put

    points, quads = _grid(200, 150)
    for number in range(min(frames, 24)):
        data = obj_bytes(points * (1 + 1e-4 * number), _triangles(quads), "/1/1")
        put(root / f"P{number % 8}/1+2/1+2_{number // 8}.obj", data)
    return {"kind": "d3dfacs", "root": root}


def _warehouse(root: Path, frames: int) -> dict[str, object]:
    from tests.support.face_sets import obj_bytes, put, shape_bytes

    points, quads = _grid(120, 96)
    shapes = np.stack([points * (1 + 1e-4 * k) for k in range(47)]) / 110
    for number in range(1, 9):
        put(root / f"Tester_{number}/Blendshape/shape.bs", shape_bytes(shapes))
        put(root / f"Tester_{number}/Blendshape/shape_0.obj", obj_bytes(shapes[0], quads, "/1/1"))
    return {"kind": "facewarehouse", "root": root, "steps": max(1, frames // 8 // 46)}


def _poses(root: Path, _frames: int) -> dict[str, object]:
    from tests.support.face_sets import obj_bytes, put

    points, quads = _grid(120, 96)
    data = obj_bytes(points / 110, quads, "/1/1")
    for number in range(20):
        put(root / f"Tester_1/TrainingPose/pose_{number}.obj", data)
    return {"kind": "facewarehouse", "root": root}


def _biwi(root: Path, frames: int) -> dict[str, object]:
    from tests.support.face_sets import obj_bytes, pose_text, put

    points, quads = _grid(93, 74)
    for number in range(1, 9):
        data = obj_bytes((points - [3, 12, 0]) * [1, -1, -1], _triangles(quads), "//1")
        put(root / f"{number:02d}.obj", data)
        for frame in range(frames // 8):
            pose = pose_text(np.eye(3), (0.0, 0.0, 900.0))
            put(root / f"{number:02d}/frame_{frame:05d}_pose.txt", pose)
    return {"kind": "biwi", "root": root}


MAKERS: dict[str, Callable[[Path, int], dict[str, object]]] = {
    "d3dfacs, binary PLY": _registrations,
    "facewarehouse, shape.bs": _warehouse,
    "biwi, posed template": _biwi,
    "facewarehouse, pose_K.obj": _poses,
    "d3dfacs, raw OBJ": _raw,
}
RENDERED = tuple(MAKERS)[:3]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1200, help="about so many per set")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-render", action="store_true", help="measure reading only")
    arguments = parser.parse_args()
    reading = Table("files", "vertices", "ms per frame", "first ms", "frames/s", title="reading")
    rates = Table("files", "from disk /s", "from memory /s", "share", title="rendering")
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, make) in enumerate(MAKERS.items()):
            root = Path(folder) / str(number)
            settings = parse_source(make(root, arguments.frames))
            reading.add_row(name, *_reading(settings))
            if name in RENDERED and not arguments.no_render:
                rates.add_row(name, *_rendering(settings, Path(folder), arguments.workers))
    Console(width=110).print(reading)
    if rates.row_count:
        Console(width=110).print(rates)


def _reading(settings: SourceSettings) -> list[str]:
    """Vertices, ms per frame once the scale is known, ms of the first frame, frames per second."""
    source = open_source(settings, 0)
    keys = source.frames(source.subjects(None)[0], 150)
    started = time.perf_counter()
    (first,) = source.load(keys[:1])
    first_ms = 1000 * (time.perf_counter() - started)
    assert isinstance(first, Face), first
    started = time.perf_counter()
    count = sum(isinstance(face, Face) for face in source.load(keys))
    seconds = (time.perf_counter() - started) / count
    vertices = len(first.mesh.vertices_mm)
    return [str(vertices), f"{1000 * seconds:.2f}", f"{first_ms:.0f}", f"{1 / seconds:.0f}"]


def _rendering(source_settings: SourceSettings, folder: Path, workers: int) -> list[str]:
    """Frames per second from disk and from memory, and their ratio."""
    from glsim.dataset.driver import write_dataset
    from glsim.pipeline import simulate
    from glsim.plan.tasks import make_tasks

    settings: Settings = load_settings(overrides={"sensor": SENSOR}).model_copy(
        update={"source": (source_settings,)}
    )
    disk = open_source(source_settings, 0)
    tasks = make_tasks(settings, [disk])
    memory = InMemory(disk, [task.key for task in tasks])
    rates = []
    fresh = open_source(source_settings, 0)
    for number, source in enumerate((memory, fresh, memory, fresh)):
        out = folder / f"out-{source_settings.kind}-{number}"
        summary = write_dataset(
            settings,
            tasks,
            out,
            partial(simulate, sources=[source], layers=settings.output.layers),
            sensor={"name": SENSOR},
            renderer="benchmark",
            workers=workers,
        )
        assert summary.rendered == len(tasks)
        assert not summary.skipped, summary.skipped
        rates.append(summary.rendered / summary.seconds)
    in_memory, on_disk = max(rates[0], rates[2]), max(rates[1], rates[3])
    return [f"{on_disk:.0f}", f"{in_memory:.0f}", f"{100 * on_disk / in_memory:.0f} %"]


if __name__ == "__main__":
    from benchmarks import sources  # workers must find InMemory under its module's name

    sources.main()
