"""Resident memory of a worker over many frames: python -m benchmarks.memory [--frames 20000].

One process renders, assembles and encodes pairs as a worker of ``glsim generate`` does. Memory is
read after the first tenth, when caches are full, and at the end; growth should be under 2 %.
--simulations N opens and closes ``simulate`` N times instead, each for one frame.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from rich.console import Console

from benchmarks.faces import settings_for, source_for


def resident_mb() -> float:
    """Resident memory of this process, from /proc (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description="Resident memory of a worker over many frames.")
    parser.add_argument(
        "--ict-root", type=Path, help="FaceXModel folder; default: procedural faces"
    )
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--simulations", type=int, help="Simulations to open and close.")
    arguments = parser.parse_args()

    from glsim.files.png import encode_png
    from glsim.frame import Frame
    from glsim.pipeline import simulate
    from glsim.plan.tasks import make_tasks

    out = Console()
    if arguments.simulations:
        settings = settings_for(arguments.ict_root, 1)
        sources = [source_for(arguments.ict_root)]
        for number in range(arguments.simulations):
            if number == arguments.simulations // 2:
                start = resident_mb()
            for _ in simulate(settings, sources=sources):
                pass
        growth_kb = 1000 * (resident_mb() - start) / (arguments.simulations / 2)
        out.print(f"{growth_kb:.1f} kB per simulation in the second half, {resident_mb():.0f} MB")
        return
    settings = settings_for(arguments.ict_root, arguments.frames)
    sources = [source_for(arguments.ict_root)]
    tasks = make_tasks(settings, sources)
    early = len(tasks) // 10
    start = 0.0
    for number, frame in enumerate(simulate(settings, tasks, sources=sources), start=1):
        assert isinstance(frame, Frame)
        encode_png(frame.clean)
        encode_png(frame.noisy)
        if number == early:
            start = resident_mb()
        if number % early == 0:
            out.print(f"{number:6d} frames: {resident_mb():.1f} MB")
    growth = 100 * (resident_mb() / start - 1)
    out.print(f"growth over the last {len(tasks) - early} frames: {growth:+.2f} %")


if __name__ == "__main__":
    main()
