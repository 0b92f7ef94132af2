"""Memory of one process that runs long: python -m benchmarks.stress long_runs [--count 20000].

Three runs, each in a process of its own: ``count`` frames of procedural faces; as many of meshes of
300 topologies in turn (each at least three times); and count / 100 simulations opened and closed
(200 for 20,000). Memory is read after the first tenth, of topologies after two turns at least, when
caches are full; and at the end. Growth must stay under 2 %, or under 4 MB in a short run.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

_PERCENT = 2.0
#: Growth of the heap that one frame may cause; negligible in a long run.
_LEAST_MB = 4.0
_TOPOLOGIES = 300


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the three and print a table; returns 1 if memory grew."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stress long_runs",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--count", type=int, default=20_000, help="frames of a run")
    parser.add_argument("--runs", default=",".join(_RUNS), help="some of them")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    names = options.runs.split(",")
    if options.one:
        print(json.dumps(measure(_RUNS[names[0]](options.count))))
        return 0
    print(f"{'run':14}{'steps':>8}{'early MB':>10}{'end MB':>9}{'growth':>9}  result")
    failures = 0
    for name in names:
        command = [sys.executable, "-m", "benchmarks.stress", "long_runs", "--one"]
        command += ["--runs", name, "--count", str(options.count)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            failures += 1
            print(f"{name:14}{'':36}  FAILED: {done.stderr.strip()[-300:]}")
            continue
        row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        grown_mb = row["end_mb"] - row["early_mb"]
        percent = 100 * grown_mb / row["early_mb"]
        failed = percent > _PERCENT and grown_mb > _LEAST_MB
        failures += failed
        print(
            f"{name:14}{row['steps']:8}{row['early_mb']:10.1f}{row['end_mb']:9.1f}{percent:8.2f}%"
            f"  {'FAILED: memory grows' if failed else 'flat'}",
            flush=True,
        )
    print(f"{len(names)} long runs, {failures} failures")
    return 1 if failures else 0


def measure(steps: Iterator[bool]) -> dict[str, float]:
    """Take all steps; memory is read first where a step says that caches are full now."""
    early = 0.0
    count = 0
    for full in steps:
        count += 1
        if full:
            gc.collect()
            early = resident_mb()
    gc.collect()
    return {"steps": count, "early_mb": early, "end_mb": resident_mb()}


def resident_mb() -> float:
    """Resident memory of this process, from /proc (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def frames(count: int) -> Iterator[bool]:
    """Render and encode frames as a worker of ``glsim generate`` does."""
    from benchmarks.faces import settings_for, source_for
    from glsim.files.png import encode_png
    from glsim.frame import Frame
    from glsim.pipeline import simulate
    from glsim.plan.tasks import make_tasks

    settings = settings_for(None, count)
    sources = [source_for(None)]
    tasks = make_tasks(settings, sources)
    for number, frame in enumerate(simulate(settings, tasks, sources=sources), start=1):
        assert isinstance(frame, Frame)
        encode_png(frame.clean)
        encode_png(frame.noisy)
        yield number == max(1, len(tasks) // 10)


def topologies(count: int) -> Iterator[bool]:
    """Render 300 mesh files in turn, each with another number of vertices.

    All turns use one source, which aligns each mesh once: that takes ten times as long as a frame.
    Yields once per frame: True for the early measurement, when each was rendered twice or more.
    """
    from glsim.frame import Frame
    from glsim.pipeline import open_sources, simulate
    from glsim.settings.schema import load_settings

    kinds = min(_TOPOLOGIES, max(2, count // 3))
    turns = max(3, count // kinds)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in range(kinds):
            _write_head(folder / f"head-{kind:03d}.obj", 12 + kind)
        overrides = {"sensor": "ideal", "output": {"crop": 96}}
        source = {"kind": "folder", "root": str(folder)}
        settings = load_settings(overrides=overrides, source=source)
        sources = open_sources(settings)
        done = 0
        for _ in range(turns):
            for frame in simulate(settings, sources=sources):
                assert isinstance(frame, Frame), frame
                done += 1
                yield done == max(2 * kinds, kinds * turns // 10)


def _write_head(path: Path, columns: int) -> None:
    """Write a front of a head, 24 rows of ``columns`` points, mm, as an OBJ file."""
    up, around = np.meshgrid(np.linspace(-1, 1, 24), np.linspace(-1.2, 1.2, columns), indexing="ij")
    width = np.sqrt(1.02 - up**2)
    x, y, z = 80 * width * np.sin(around), 120 * up, 95 * width * np.cos(around)
    z += 22 * np.exp(-((x / 14) ** 2) - ((y + 10) / 22) ** 2)  # a nose
    lines = [f"v {a:.3f} {b:.3f} {c:.3f}" for a, b, c in zip(x.flat, y.flat, z.flat, strict=True)]
    for row in range(23):
        for column in range(columns - 1):
            first = row * columns + column + 1
            below = first + columns
            lines.append(f"f {first} {first + 1} {below + 1} {below}")
    path.write_text("\n".join(lines) + "\n")


def contexts(count: int) -> Iterator[bool]:
    """Open and close ``simulate``, for one frame each."""
    from benchmarks.faces import settings_for, source_for
    from glsim.pipeline import simulate

    settings = settings_for(None, 1)
    sources = [source_for(None)]
    simulations = max(4, count // 100)
    for number in range(1, simulations + 1):
        for _ in simulate(settings, sources=sources):
            pass
        yield number == max(2, simulations // 10)


_RUNS: dict[str, Callable[[int], Iterator[bool]]] = {
    "frames": frames,
    "topologies": topologies,
    "contexts": contexts,
}
