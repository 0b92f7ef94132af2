"""Cost of cameras that match images: python -m benchmarks.stereo [--frames 10] [--turns 5].

Pairs: CPU time of one clean and one noisy depth map of a face before a wall, of all threads of the
process, for the whole frame and for a window of 160 px. The sensors take turns in one process, a
new face in every frame; the medians of the turns count, and each is compared with kinect-v2's.

Matching alone: frames a second by the clock, of a RealSense D435's two images in memory, beside
what SimSense publishes for its CUDA matcher on an RTX 2080 Ti (github.com/angli66/simsense 99b266c,
README: 848x480, without and with block sums, rendering not included).
"""

import argparse
import os
import platform
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from glsim import Frame, load_settings, open_context, open_sources
from glsim.noise.registry import shipped_stages
from glsim.noise.semi_global import match
from glsim.sensors.sensor import load_sensor
from glsim.simulation.pipeline import Simulator
from glsim.simulation.plan.tasks import make_tasks

#: What the others are compared with, and they.
BASE = "kinect-v2"
SENSORS = (BASE, "realsense-d435", "truedepth", "truedepth-filtered", "kinect-v1-pattern")
#: The face's distance from the camera and the wall's, mm.
_FACE_MM, _WALL_MM = 600.0, 1200.0
_CROP_PX = 160
#: Disparities searched -> frames a second that SimSense publishes, with and without block sums.
SIMSENSE_FPS = {128: (124.1, 148.7), 64: (195.7, 231.0)}


def main() -> None:
    """Measure and print two tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", type=int, default=10, help="frames of a sensor in each turn")
    parser.add_argument("--turns", type=int, default=5)
    arguments = parser.parse_args()
    console = Console()
    console.print(f"{machine()}; load before: {os.getloadavg()[0]:.2f}")
    console.print(pair_table(arguments.frames, arguments.turns))
    console.print(matching_table(arguments.turns))


def machine() -> str:
    """Name the processor, its cores, and the versions that matter."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    name = next(names, platform.processor() or platform.machine())
    return f"{name}, {os.cpu_count()} cores, OpenCV {cv2.__version__}"


def pair_table(frames: int, turns: int) -> Table:
    """Return the CPU time of a pair per sensor, and its ratio to BASE."""
    table = Table(title="CPU of a pair, ms: a face before a wall")
    for name in ("sensor", "whole frame", f"over {BASE}", f"{_CROP_PX} px", f"over {BASE}"):
        table.add_column(name, justify="left" if name == "sensor" else "right")
    whole, cut = (pair_times(crop, frames, turns) for crop in (None, _CROP_PX))
    for sensor in SENSORS:
        image = load_sensor(sensor).rig.intrinsics
        table.add_row(
            f"{sensor}, {image.width}x{image.height}",
            f"{whole[sensor]:.1f}",
            f"{whole[sensor] / whole[BASE]:.2f}",
            f"{cut[sensor]:.1f}",
            f"{cut[sensor] / cut[BASE]:.2f}",
        )
    return table


def pair_times(crop: int | None, frames: int, turns: int) -> dict[str, float]:
    """Return the median CPU time of a pair per sensor, milliseconds."""
    running = {sensor: _frames(sensor, crop, frames * turns + 1) for sensor in SENSORS}
    for made in running.values():
        next(made)  # the first frame compiles shaders
    times: dict[str, list[float]] = {sensor: [] for sensor in SENSORS}
    for _ in range(turns):
        for sensor, made in running.items():
            start = time.process_time()
            for _ in range(frames):
                next(made)
            times[sensor].append(1000 * (time.process_time() - start) / frames)
    return {sensor: statistics.median(of_turns) for sensor, of_turns in times.items()}


def _frames(sensor: str, crop: int | None, count: int) -> Iterator[Frame]:
    """Yield frames of generated faces, each of another person."""
    settings = load_settings(
        overrides={
            "sensor": sensor,
            "pose": {"distance_mm": _FACE_MM},
            "scene": {"wall_mm": _WALL_MM},
            "output": {"crop": crop},
            "strict": True,
        },
        source={"subjects": count, "frames_per_subject": 1},
    )
    sources = open_sources(settings)
    layers = ("clean", "noisy", "reason", "infrared")
    simulator = Simulator(settings, sources, open_context(), (), layers)
    for frame in simulator.frames(make_tasks(settings, sources)):
        assert isinstance(frame, Frame)
        yield frame


def matching_table(turns: int) -> Table:
    """Return frames a second of matching alone beside SimSense's."""
    table = Table(title="matching alone, 848x480, frames a second by the clock")
    for name in ("disparities", "here", "here, CPU ms a frame", "SimSense, RTX 2080 Ti"):
        table.add_column(name, justify="right")
    left, right = infrared_pair()
    for disparities, published in SIMSENSE_FPS.items():
        values = {n: p.default for n, p in shipped_stages()["match_stereo"].parameters.items()}
        values["disparities"] = disparities
        clock, cpu = [], []
        for _ in range(turns * 4):
            start = time.perf_counter(), time.process_time()
            match(left, right, values)
            clock.append(time.perf_counter() - start[0])
            cpu.append(1000 * (time.process_time() - start[1]))
        table.add_row(
            str(disparities),
            f"{1 / statistics.median(clock):.1f}",
            f"{statistics.median(cpu):.0f}",
            "{:g} to {:g}".format(*published),
        )
    return table


def infrared_pair() -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float32]], ...]:
    """Return the two infrared images of a D435, counts."""
    settings = load_settings(
        overrides={
            "sensor": "realsense-d435",
            "pose": {"distance_mm": _FACE_MM},
            "scene": {"wall_mm": _WALL_MM},
        },
        source={"subjects": 1, "frames_per_subject": 1},
    )
    sources = open_sources(settings)
    layers = ("clean", "noisy", "infrared", "infrared_right")
    (frame,) = Simulator(settings, sources, open_context(), (), layers).frames(
        make_tasks(settings, sources)
    )
    assert isinstance(frame, Frame)
    return frame.infrared.astype(np.float32), frame.infrared_right.astype(np.float32)


if __name__ == "__main__":
    main()
