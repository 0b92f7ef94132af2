"""Measure error and gain of occluders: python -m benchmarks.occluders [--ict-root FaceXModel].

Error: each face is drawn twice at 0.9 m, by all its triangles and by those of its occluder
(`glsim/geometry/occluder.py`): how far the surface moves, mm along the axis, and the share of the
silhouette's pixels that differ. Gain: frames of two simulators in turn, one of which lets all
triangles cast shadows: the median ratio of CPU time, and the noisy pixels that differ. The turns
make the ratio hold on a machine whose speed changes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.faces import source_for
from glsim.faces.base import BadFace, Face, FaceKey, FaceSource
from glsim.faces.people import People
from glsim.frame import Frame
from glsim.geometry.mesh import Mesh
from glsim.geometry.pose import pose_matrix
from glsim.gl.context import open_context
from glsim.gl.targets import Readback
from glsim.pipeline import Simulator
from glsim.plan.tasks import make_tasks
from glsim.render.renderer import Renderer
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings, load_settings

SENSORS = ("kinect-v2-paper", "kinect-v2")
_WARM_UP = 8


class AllTriangles:
    """A face source whose meshes cast shadows with all their triangles."""

    def __init__(self, source: FaceSource) -> None:
        self._source, self.name = source, source.name

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def load(self, keys: Sequence[FaceKey]) -> Iterator[Face | BadFace]:
        """Yield the faces without their occluders."""
        for face in self._source.load(keys):
            assert isinstance(face, Face), face
            yield replace(face, mesh=replace(face.mesh, occluder=None))


def main() -> None:
    """Measure the error and the gain of occluders, and print a table of each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--ict-root", type=Path, help="FaceXModel folder; default: left out")
    parser.add_argument("--people", action="store_true", help="people too (glsim fetch people)")
    parser.add_argument("--frames", type=int, default=100, help="frames per source")
    arguments = parser.parse_args()
    sources: list[FaceSource] = [source_for(None)]
    if arguments.ict_root is not None:
        sources.append(source_for(arguments.ict_root))
    if arguments.people:
        sources.append(People(0))
    context = open_context()
    errors = Table(title="the surface of occluders, mm")
    for column in ("faces", "triangles", "left", "median", "90 %", "99 %", "99.9 %", "silhouette"):
        errors.add_column(column, justify="left" if column == "faces" else "right")
    gains = Table(title="frames with occluders against frames with all triangles")
    for column in ("faces", "sensor", "CPU", "validity differs, px", "by over 2 mm, px"):
        gains.add_column(column, justify="left" if column in ("faces", "sensor") else "right")
    for source in sources:
        errors.add_row(source.name, *_errors(context, source, arguments.frames))
        for sensor in SENSORS:
            gains.add_row(source.name, sensor, *_gain(context, source, sensor, arguments.frames))
    Console(width=110).print(errors, gains)


def _settings(sensor: str, frames: int) -> Settings:
    """Return the settings of about ``frames`` frames, four a person."""
    return load_settings(
        overrides={"sensor": sensor, "pose": {"distance_mm": 900.0}},
        source={"subjects": -(-frames // 4), "frames_per_subject": 4},
    )


def _errors(context: moderngl.Context, source: FaceSource, frames: int) -> list[str]:
    """Return the cells of one row: triangles, those left, percentiles, share of the silhouette."""
    settings = _settings("kinect-v2", frames)
    renderer = Renderer(context, replace(sensor_of(settings).rig, emitters=(), supersample=1))
    moved: list[NDArray[np.float32]] = []
    other = seen = triangles = left = 0
    for face in source.load([task.key for task in make_tasks(settings, [source])[:frames]]):
        assert isinstance(face, Face), face
        assert face.mesh.occluder is not None
        triangles, left = len(face.mesh.faces), len(face.mesh.occluder)
        whole = _depth_m(context, renderer, face.mesh)
        fewer = _depth_m(context, renderer, replace(face.mesh, faces=face.mesh.occluder))
        both = (whole > 0) & (fewer > 0)
        moved.append(1000 * np.abs(whole - fewer)[both])
        other += int(((whole > 0) != (fewer > 0)).sum())
        seen += int((whole > 0).sum())
    percentiles = np.percentile(np.concatenate(moved), [50, 90, 99, 99.9])
    cells = [f"{triangles:,}", f"{left:,}", *(f"{value:.2f}" for value in percentiles)]
    return [*cells, f"{100 * other / seen:.2f} %"]


def _depth_m(context: moderngl.Context, renderer: Renderer, mesh: Mesh) -> NDArray[np.float32]:
    """Render a mesh at 0.9 m; return its clean depth, m, (h, w) of the window that it fills."""
    readback = Readback(context)
    with renderer.render([(mesh, pose_matrix({"distance_mm": 900.0}))]) as rendered:
        readback.request(rendered.pool, {"clean": rendered.layers["clean"]}, rendered.window)
    return readback.arrays()["clean"]


def _gain(context: moderngl.Context, source: FaceSource, sensor: str, frames: int) -> list[str]:
    """Return the cells of one row: ratio of CPU time, and pixels that differ."""
    settings = _settings(sensor, frames + _WARM_UP)
    tasks = make_tasks(settings, [source])[: frames + _WARM_UP]
    simulators = [
        Simulator(settings, [one], context, ("clean", "noisy"))
        for one in (AllTriangles(source), source)
    ]
    ratios, flips, far = [], 0, 0
    for number, task in enumerate(tasks):
        cpu, made = [], []
        for simulator in simulators:
            start = time.process_time()
            made += [frame for frame in simulator.frames([task]) if isinstance(frame, Frame)]
            cpu.append(time.process_time() - start)
        if number < _WARM_UP or len(made) < len(simulators):
            continue
        ratios.append(cpu[1] / cpu[0])
        exact, found = (frame.noisy.astype(int) for frame in made)
        flips += int(((exact > 0) != (found > 0)).sum())
        far += int((np.abs(exact - found)[(exact > 0) & (found > 0)] > 2).sum())
    count = len(ratios)
    return [f"{np.median(ratios):.3f}", f"{flips / count:.1f}", f"{far / count:.1f}"]


if __name__ == "__main__":
    main()
