"""One contender of benchmarks.generate: python -m benchmarks.contender NAME FRAMES OUT [ICT_ROOT].

Prints one JSON line: ms of CPU a pair for each step, in all, and ms of wall.
"""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.faces import settings_for, source_for
from glsim.bounds import Sight, corners, image_window
from glsim.distribution import DrawKeys
from glsim.frame import Rect, encode_depth
from glsim.mesh import Mesh
from glsim.noise.chain import run_twins
from glsim.noise.view import FrameContext
from glsim.pipeline import draw_values
from glsim.pose import pose_matrix
from glsim.sensor import Sensor, sensor_of

#: Frames that are made before the clock starts: shaders compile, caches fill.
WARM_UP = 10

#: How far in front of a point something must be to shadow it, m: the shader's order of magnitude.
SHADOW_BIAS_M = 0.003

#: (mesh, window) to clean depth and lit share of the window, both (h, w) float32.
Renderer = Callable[[Mesh, Rect], tuple[NDArray[np.float32], NDArray[np.float32]]]


class Clock:
    """CPU seconds by step, wall in all."""

    def __init__(self) -> None:
        self.cpu: dict[str, float] = defaultdict(float)
        self.restart()

    def restart(self) -> None:
        self.cpu.clear()
        self._start = time.process_time(), time.perf_counter()

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        start = time.process_time()
        yield
        self.cpu[name] += time.process_time() - start

    def report(self, frames: int) -> dict[str, float]:
        cpu = time.process_time() - self._start[0]
        wall = time.perf_counter() - self._start[1]
        steps = {name: 1000 * seconds / frames for name, seconds in self.cpu.items()}
        rest = 1000 * (cpu - sum(self.cpu.values())) / frames
        return steps | {
            "other": rest, "cpu_ms": 1000 * cpu / frames, "wall_ms": 1000 * wall / frames
        }  # fmt: skip


def run_glsim(frames: int, out: Path, ict_root: Path | None) -> dict[str, float]:
    """Simulator and frame writer, as ``glsim generate`` runs them in a worker."""
    from glsim.dataset import write_frame
    from glsim.frame import Frame
    from glsim.pipeline import simulate
    from glsim.plan import make_tasks

    settings = settings_for(ict_root, frames + WARM_UP)
    sources = [source_for(ict_root)]
    tasks = make_tasks(settings, sources)[: frames + WARM_UP]
    clock = Clock()
    for number, frame in enumerate(simulate(settings, tasks, sources=sources)):
        if number == WARM_UP:
            clock.restart()
        assert isinstance(frame, Frame)
        with clock.step("PNG and disk"):
            write_frame(frame, out, f"{number:06d}", ("clean", "noisy"))
    return clock.report(len(tasks) - WARM_UP)


def run_peer(name: str, frames: int, out: Path, ict_root: Path | None) -> dict[str, float]:
    """A peer's depth and shadow, NumPy noise, OpenCV's PNGs."""
    import cv2

    settings = settings_for(ict_root, frames + WARM_UP)
    sensor = sensor_of(settings)
    image = sensor.rig.intrinsics
    whole = Rect(0, 0, image.width, image.height)
    clock = Clock()
    if name.startswith("open3d"):
        from benchmarks.open3d_peer import Open3DRenderer

        render: Renderer = Open3DRenderer(sensor.rig, clock.step)
    else:
        from benchmarks.pyrender_peer import PyrenderRenderer

        render = PyrenderRenderer(sensor.rig, clock.step)
    source = source_for(ict_root)
    keys = [
        key
        for subject in source.subjects(settings.source[0].subjects)
        for key in source.frames(subject, settings.source[0].frames_per_subject)
    ][: frames + WARM_UP]
    view = pose_matrix({"distance_mm": 900.0})
    rays, sight = sensor.rig.rays(), Sight.of(sensor.rig)
    loaded = iter(source.load(keys))
    for number in range(len(keys)):
        if number == WARM_UP:
            clock.restart()
        with clock.step("face"):
            mesh = next(loaded).mesh  # type: ignore[union-attr]
        box = corners(mesh.vertices_mm, view)
        window = whole if name.endswith("full") else image_window(box, sight, None)
        clean, lit = render(mesh, window)
        with clock.step("noise"):
            noisy = _noise(sensor, clean, lit, rays[window.slices], window, number)
        with clock.step("PNG and disk"):
            for layer, depth in (("clean", clean), ("noisy", noisy)):
                full = np.zeros((image.height, image.width), np.uint16)
                full[window.slices] = encode_depth(depth)
                cv2.imwrite(str(out / f"{number:06d}_{layer}.png"), full)
    return clock.report(len(keys) - WARM_UP)


def _noise(
    sensor: Sensor,
    clean: NDArray[np.float32],
    lit: NDArray[np.float32],
    rays: NDArray[np.float32],
    window: Rect,
    seed: int,
) -> NDArray[np.float32]:
    image = sensor.rig.intrinsics
    layers = {
        "clean": clean,
        "depth": clean,
        "reason": np.zeros_like(clean),
        "lit": lit,
        "rays": rays,
    }
    # Only the infrared stage needs normals and albedo; no infrared image is asked for here.
    stages = [stage for stage in sensor.stages if stage.name != "infrared"]
    _, values = draw_values(stages, DrawKeys(seed, seed, seed))
    context = FrameContext(
        window, image.width, image.height, seed, seed, 0, 0.0, image.fx * sensor.rig.baseline_m
    )
    run_twins(stages, layers, context, values)
    return layers["depth"]


def main() -> None:
    name, frames, out = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    ict_root = Path(sys.argv[4]) if len(sys.argv) > 4 else None
    run = run_glsim if name == "glsim" else lambda *rest: run_peer(name, *rest)
    print(json.dumps(run(frames, out, ict_root)))


if __name__ == "__main__":
    main()
