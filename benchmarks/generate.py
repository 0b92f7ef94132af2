"""Pairs per second: glsim against Open3D and pyrender with NumPy noise, on the same meshes.

    python -m benchmarks.generate [--ict-root FaceXModel] [--frames 300]
    python -m benchmarks.generate --scenes --frames 60      heads, people and rooms

Every contender gets the same faces (a new one every frame), makes clean depth, shadow and noise
at 512x424, and writes two 16-bit PNGs to disk, in one process on one core. Peers add the noise of
`benchmarks/lean_noise.py`, which does less than the sensor, and write PNGs with OpenCV at its
default settings, as their users would. The result is CPU time, which depends least on other load
of the machine. Each contender runs in its own process; the medians of three turns count.
"""

import argparse
import importlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from glsim.faces.face_source import Face, FaceSource
from glsim.settings.schema import Settings, load_settings

#: Name -> title. The first is what the others are compared with.
CONTENDERS = {
    "kinect-v2-paper": "glsim, kinect-v2-paper",
    "kinect-v2": "glsim, kinect-v2",
    "kinect-v2-fast": "glsim, kinect-v2-fast",
    "open3d": "Open3D ray casting, lean noise",
    "pyrender": "pyrender, lean noise",
}
_PEERS = ("open3d", "pyrender")
#: Scene -> sensor, kind of source, preset, assignments; each is also timed as a crop of 128 px.
_SCENES: dict[str, tuple[str, str, str | None, list[str]]] = {
    "heads, bare": ("kinect-v2", "procedural", None, []),
    "heads, dressed": ("kinect-v2", "procedural", None, ["appearance.wear=always"]),
    "people": ("kinect-v2", "people", None, []),
    "people in an office": ("kinect-v2", "people", "office", []),
    "bare, azure-kinect": ("azure-kinect", "procedural", None, []),
    "bare, realsense-d435": ("realsense-d435", "procedural", None, []),
    "bare, truedepth": ("truedepth", "procedural", None, []),
}
_CROP = ", 128 px"
#: The scene's triangles by a peer, whole frames; persons are loaded and dressed as for glsim.
_BY_OPEN3D = ", Open3D ray casting, lean noise"
#: Frames before the clock starts: shaders compile, caches fill.
_WARM_UP = 10
_TURNS = 3


def main() -> None:
    """Time each program in turn and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--ict-root", type=Path, help="faces of ICT-FaceKit, not embedded ones")
    parser.add_argument("--frames", type=int, default=300, help="frames of glsim's rows")
    parser.add_argument("--only", nargs="+", choices=CONTENDERS, default=list(CONTENDERS))
    parser.add_argument("--scenes", action="store_true", help="time scenes instead")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        name, out = arguments.one
        run = _run_peer if _is_peer(name) else _run_glsim
        seconds = list(run(name, arguments.frames, Path(out), arguments.ict_root))
        cpu, wall = np.array(seconds[-1]) - np.array(seconds[_WARM_UP - 1])
        scale = 1000 / (len(seconds) - _WARM_UP)
        print(json.dumps({"cpu_ms": scale * cpu, "wall_ms": scale * wall}))
        return
    if arguments.scenes:
        arguments.only = [
            name + end
            for name, (sensor, *_) in _SCENES.items()
            for end in (_CROP, "", _BY_OPEN3D)
            if sensor == "kinect-v2" or end != _BY_OPEN3D
        ]
    turns = [{name: _turn(name, arguments) for name in arguments.only} for _ in range(_TURNS)]
    medians = {
        name: {key: statistics.median(turn[name][key] for turn in turns) for key in report}
        for name, report in turns[0].items()
    }
    table = Table("contender", "CPU ms", "wall ms", "pairs/s", f"of {arguments.only[0]}")
    for name, report in medians.items():
        cpu_ms = report["cpu_ms"]
        ratio = cpu_ms / medians[arguments.only[0]]["cpu_ms"]
        cells = (f"{cpu_ms:.1f}", f"{report['wall_ms']:.1f}", f"{1000 / cpu_ms:.0f}")
        table.add_row(CONTENDERS.get(name, name), *cells, f"{ratio:.1f}x")
    Console(width=120).print(table)


def _is_peer(name: str) -> bool:
    return name in _PEERS or name.endswith(_BY_OPEN3D)


def _turn(name: str, arguments: argparse.Namespace) -> dict[str, float]:
    """Run one contender in its own process, single-threaded; return its report."""
    frames = max(20, arguments.frames // 5) if _is_peer(name) else arguments.frames
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
    environment = os.environ | threads | {"PYOPENGL_PLATFORM": "egl"}
    command = [sys.executable, "-m", "benchmarks.generate", "--frames", str(frames)]
    command += ["--ict-root", str(arguments.ict_root.resolve())] if arguments.ict_root else []
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [*command, "--one", name, folder],
            env=environment, stdout=subprocess.PIPE, text=True, check=True,
        )  # fmt: skip
    report: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return report


def _faces(sensor: str, frames: int, ict_root: Path | None) -> tuple[Settings, FaceSource]:
    """Return settings of so many frames, and their source, of a new person every frame."""
    from glsim.faces.sources.ict_facekit import IctFaceKit
    from glsim.faces.sources.procedural import ProceduralFaces

    each = 60 if ict_root is None else 1
    count: dict[str, Any] = {"subjects": frames // each + 1, "frames_per_subject": each}
    if ict_root is None:
        return load_settings(overrides={"sensor": sensor}, source=count), ProceduralFaces(0)
    count |= {"kind": "ict-facekit", "root": ict_root}
    source = IctFaceKit(ict_root, 0)
    return load_settings(overrides={"sensor": sensor}, source=count), source


def _scene_settings(name: str, frames: int, sensor: str | None = None) -> Settings:
    """Return settings of a row of scenes: 20 frames of each person."""
    own, kind, preset, assignments = _SCENES[name.removesuffix(_CROP)]
    crop = ["output.crop=128"] if name.endswith(_CROP) else []
    count = {"subjects": (frames + _WARM_UP) // 20 + 1, "frames_per_subject": 20}
    return load_settings(
        None, [*assignments, *crop], {"sensor": sensor or own}, {"kind": kind, **count}, preset
    )


def _run_glsim(
    sensor: str, frames: int, out: Path, ict_root: Path | None
) -> Iterator[tuple[float, float]]:
    """Run simulator and frame writer as a worker does; yield CPU and wall clock at each frame."""
    from glsim.data.layer_images import write_frame
    from glsim.gl.context import open_context
    from glsim.simulation.frame import Frame
    from glsim.simulation.pipeline import Simulator, open_sources
    from glsim.simulation.plan.tasks import make_tasks

    if sensor.removesuffix(_CROP) in _SCENES:
        settings = _scene_settings(sensor, frames)
        sources = open_sources(settings)
    else:
        settings, source = _faces(sensor, frames + _WARM_UP, ict_root)
        sources = [source]
    tasks = make_tasks(settings, sources)[: frames + _WARM_UP]
    simulator = Simulator(settings, sources, open_context(), ("clean", "noisy"))
    for number, frame in enumerate(simulator.frames(tasks)):
        assert isinstance(frame, Frame)
        write_frame(frame, out, f"{number:06d}", ("clean", "noisy"))
        yield time.process_time(), time.perf_counter()


def _run_peer(
    name: str, frames: int, out: Path, ict_root: Path | None
) -> Iterator[tuple[float, float]]:
    """Run a peer: its depth and shadow, NumPy noise, OpenCV's PNGs."""
    import cv2

    from benchmarks.lean_noise import LeanNoise
    from glsim.core.units import to_steps
    from glsim.sensors.sensor import sensor_of
    from glsim.simulation.face_loader import FaceLoader
    from glsim.simulation.pipeline import open_sources
    from glsim.simulation.plan.tasks import make_tasks
    from glsim.simulation.scenes import FrameScenes

    scene = name.removesuffix(_BY_OPEN3D)
    if scene in _SCENES:
        name, settings = "open3d", _scene_settings(scene, frames, "kinect-v2-paper")
        sources = open_sources(settings)
    else:
        settings, source = _faces("kinect-v2-paper", frames + _WARM_UP, ict_root)
        sources = [source]
    rig = sensor_of(settings).rig
    scenes = FrameScenes(FaceLoader(settings, sources, rig), regions=False)
    tasks = make_tasks(settings, sources)[: frames + _WARM_UP]
    render = importlib.import_module(f"benchmarks.{name}_peer").Renderer(rig)
    add_noise = LeanNoise(rig)
    for number, (task, face) in enumerate(scenes.loader.load_ahead(tasks)):
        assert isinstance(face, Face), face
        points, faces, first = [], [], 0
        for mesh, view in scenes.build(task, face).meshes:
            points.append(mesh.vertices_mm @ view[:3, :3].T + view[:3, 3])
            faces.append(mesh.faces + first)
            first += len(mesh.vertices_mm)
        clean, lit = render(np.concatenate(points), np.concatenate(faces))
        for layer, depth in (("clean", clean), ("noisy", add_noise(clean, lit, number))):
            cv2.imwrite(str(out / f"{number:06d}_{layer}.png"), to_steps(depth))
        yield time.process_time(), time.perf_counter()


if __name__ == "__main__":
    main()
