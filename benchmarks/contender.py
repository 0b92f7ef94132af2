"""One contender of benchmarks.generate: python -m benchmarks.contender NAME FRAMES OUT [ICT_ROOT].

Prints one JSON line: CPU ms per pair for each step, total CPU ms and wall ms per pair.
"""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.faces import settings_for, source_for
from benchmarks.lean_noise import LeanNoise
from benchmarks.peer import PeerRenderer
from glsim.faces.base import Face
from glsim.frame import encode_depth
from glsim.geometry.bounds import FieldOfView, bounding_corners, image_window
from glsim.geometry.pose import pose_matrix
from glsim.geometry.rect import Rect
from glsim.noise.array_chain import run_twins
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import draw_values
from glsim.sensors.sensor import Sensor, sensor_of
from glsim.settings.distribution import DrawKeys
from glsim.settings.schema import Settings

#: Frames before the clock starts: shaders compile, caches fill.
WARM_UP = 10


class StepClock:
    """Measures CPU seconds per step, and total wall time."""

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


def run_glsim(sensor: str, frames: int, out: Path, ict_root: Path | None) -> dict[str, float]:
    """Run simulator and frame writer as a worker of ``glsim generate`` does.

    A first run measures the total. A second one waits for OpenGL after each step to measure the
    steps, which are scaled to the total of the first.
    """
    settings = settings_for(ict_root, frames + WARM_UP, sensor)
    total = _glsim_pass(settings, frames, out, ict_root, wait=False)
    steps = _glsim_pass(settings, frames, out, ict_root, wait=True)
    scale = total["cpu_ms"] / steps["cpu_ms"]
    return total | {step: scale * steps[step] for step in steps if not step.endswith("_ms")}


def _glsim_pass(
    settings: Settings, frames: int, out: Path, ict_root: Path | None, *, wait: bool
) -> dict[str, float]:
    from glsim.dataset import write_frame
    from glsim.frame import Frame
    from glsim.gl.context import open_context
    from glsim.pipeline import Simulator
    from glsim.plan.tasks import make_tasks

    source = source_for(ict_root)
    tasks = make_tasks(settings, [source])[: frames + WARM_UP]
    clock = StepClock()
    context = open_context()
    simulator = Simulator(settings, [source], context, ("clean", "noisy"))
    if wait:
        for owner, method, step in (
            (simulator._renderer, "_draw_surface", "clean depth"),
            (simulator._renderer._shadow_map, "draw", "shadow"),
            (simulator._chain, "run", "noise"),
        ):
            setattr(owner, method, _waiting(getattr(owner, method), clock, step, context.finish))
    for number, frame in enumerate(simulator.frames(tasks)):
        if number == WARM_UP:
            clock.restart()
        assert isinstance(frame, Frame)
        with clock.step("PNG and disk"):
            write_frame(frame, out, f"{number:06d}", ("clean", "noisy"))
    report = clock.report(len(tasks) - WARM_UP)
    context.release()
    return report


def _waiting(
    method: Callable[..., Any], clock: StepClock, step: str, finish: Callable[[], None]
) -> Callable[..., Any]:
    def timed(*arguments: Any, **named: Any) -> Any:
        with clock.step(step):
            result = method(*arguments, **named)
            finish()
        return result

    return timed


def run_peer(name: str, frames: int, out: Path, ict_root: Path | None) -> dict[str, float]:
    """Run a peer: its depth and shadow, NumPy noise, OpenCV's PNGs."""
    import cv2

    settings = settings_for(ict_root, frames + WARM_UP)
    sensor = sensor_of(settings)
    image = sensor.rig.intrinsics
    whole = Rect(0, 0, image.width, image.height)
    clock = StepClock()
    if name.startswith("open3d"):
        from benchmarks.open3d_peer import Open3DRenderer

        render: PeerRenderer = Open3DRenderer(sensor.rig, clock.step)
    else:
        from benchmarks.pyrender_peer import PyrenderRenderer

        render = PyrenderRenderer(sensor.rig, clock.step)
    lean = LeanNoise(sensor.rig) if name.endswith("lean") else None
    source = source_for(ict_root)
    keys = [
        key
        for subject in source.subjects(settings.source[0].subjects)
        for key in source.frames(subject, settings.source[0].frames_per_subject)
    ][: frames + WARM_UP]
    view = pose_matrix({"distance_mm": 900.0})
    rays, sight = sensor.rig.rays(), FieldOfView.of(sensor.rig)
    loaded = iter(source.load(keys))
    for number in range(len(keys)):
        if number == WARM_UP:
            clock.restart()
        with clock.step("face"):
            face = next(loaded)
        assert isinstance(face, Face), face
        mesh = face.mesh
        box = bounding_corners(mesh.vertices_mm, view)
        window = image_window(box, sight, None) if name.endswith("window") else whole
        clean, lit = render(mesh, window)
        with clock.step("noise"):
            if lean is not None:
                noisy = lean(clean, lit, number)
            else:
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
    context = FrameContext.for_frame(
        rig=sensor.rig, window=window, seed=seed, sequence_seed=seed, device_seed=0
    )
    run_twins(stages, layers, context, values)
    return layers["depth"]


def main() -> None:
    name, frames, out = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    ict_root = Path(sys.argv[4]) if len(sys.argv) > 4 else None
    if name.startswith("glsim"):
        report = run_glsim(name.removeprefix("glsim-"), frames, out, ict_root)
    else:
        report = run_peer(name, frames, out, ict_root)
    print(json.dumps(report))


if __name__ == "__main__":
    main()
