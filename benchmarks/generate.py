"""Pairs per second: glsim against Open3D and pyrender with NumPy noise, on the same meshes.

    python -m benchmarks.generate [--ict-root FaceXModel] [--frames 300]

Every contender gets the same faces (a new one every frame), makes clean depth, shadow and noise
at 512x424, and writes two 16-bit PNGs to disk, in one process on one core. Peers write PNGs with
OpenCV at its default settings, as their users would. Their noise is one of three:

    lean      what a good user writes (`benchmarks/lean_noise.py`), of the full frame: less than the
              sensor does, so that the ratio flatters the peer
    full      glsim's own NumPy twin of the chain of kinect-v2-paper, of the full frame
    window    the same, with rays and noise restricted by hand to the window of the face

The result is CPU time, which depends least on other load of the machine; wall time is beside it.
Each contender runs in its own process (pyrender leaves the GL state unusable for others). All take
turns, three times by default, and the medians count: a machine may change its speed meanwhile.

The last columns are the CPU time of a row over that of glsim with kinect-v2-paper, and that of
Open3D with lean noise over the row's. The peers' noise is that of kinect-v2-paper in all rows.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

CONTENDERS = {
    "glsim-kinect-v2-paper": "glsim, kinect-v2-paper",
    "glsim-kinect-v2": "glsim, kinect-v2",
    "glsim-kinect-v2-fast": "glsim, kinect-v2-fast",
    "open3d-lean": "Open3D ray casting, lean noise",
    "open3d-full": "Open3D ray casting, full frame",
    "open3d-window": "Open3D ray casting, window of the face",
    "pyrender-lean": "pyrender, lean noise",
    "pyrender-full": "pyrender, full frame",
    "pyrender-window": "pyrender, window of the face",
}
#: What the other columns are measured against: the same sensor's noise in glsim, and the peer that
#: a good user would write.
OURS, PEER = "glsim-kinect-v2-paper", "open3d-lean"
STEPS = ("face", "clean depth", "shadow", "noise", "PNG and disk", "other")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--ict-root", type=Path, help="FaceXModel folder; default: procedural faces"
    )
    parser.add_argument(
        "--frames", type=int, default=100, help="pairs by glsim in each turn; a fifth by peers"
    )
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument(
        "--only", nargs="+", choices=CONTENDERS, default=list(CONTENDERS), help="default: all"
    )
    arguments = parser.parse_args()
    turns = [
        {name: _run(name, arguments) for name in arguments.only} for _ in range(arguments.turns)
    ]
    results = {name: _median([turn[name] for turn in turns]) for name in arguments.only}
    _print(results, arguments)
    if OURS in results:
        _print_scaling(arguments)


def _median(reports: list[dict[str, float]]) -> dict[str, float]:
    """Return the median of each number of several reports."""
    return {key: statistics.median(report[key] for report in reports) for key in reports[0]}


def _run(name: str, arguments: argparse.Namespace) -> dict[str, float]:
    """Run one contender in its own process, single-threaded; return its report."""
    frames = arguments.frames if name.startswith("glsim") else max(20, arguments.frames // 5)
    environment = os.environ | {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "LP_NUM_THREADS": "0",
        "PYOPENGL_PLATFORM": "egl",
    }
    ict_root = [str(arguments.ict_root.resolve())] if arguments.ict_root else []
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.contender", name, str(frames), folder]
        done = subprocess.run(
            [*command, *ict_root], env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
    report: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return report


def _print(results: dict[str, dict[str, float]], arguments: argparse.Namespace) -> None:
    ours, peer = results.get(OURS), results.get(PEER)
    faces = "ICT-FaceKit" if arguments.ict_root else "procedural"
    table = Table(title=f"{faces} faces, 512x424, CPU ms per pair")
    for column in ("contender", *STEPS, "CPU ms", "wall ms", "pairs/s", "of glsim", "lean peer"):
        table.add_column(column, justify="left" if column == "contender" else "right")
    for name, report in results.items():
        table.add_row(
            CONTENDERS[name],
            *(f"{report[step]:.2f}" if step in report else "" for step in STEPS),
            f"{report['cpu_ms']:.1f}",
            f"{report['wall_ms']:.1f}",
            f"{1000 / report['cpu_ms']:.0f}",
            f"{report['cpu_ms'] / ours['cpu_ms']:.1f}x" if ours else "",
            f"{peer['cpu_ms'] / report['cpu_ms']:.1f}x" if peer else "",
        )
    Console(width=160).print(table)


def _print_scaling(arguments: argparse.Namespace) -> None:
    """Print the rates of ``glsim generate`` with one and with two workers."""
    from benchmarks.faces import settings_for
    from glsim.dataset import generate

    rates = {}
    frames = 20 * arguments.frames
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            settings = settings_for(arguments.ict_root, frames)
            summary = generate(settings, Path(folder) / "data", workers=workers)
        rates[workers] = summary.rendered / summary.seconds
        Console().print(
            f"glsim generate, {workers} worker(s): {rates[workers]:.1f} pairs/s, "
            f"{1000 * summary.cpu_seconds / summary.rendered:.2f} CPU ms per pair"
        )
    Console().print(f"2 workers are {rates[2] / rates[1]:.2f}x as fast as 1")


if __name__ == "__main__":
    main()
