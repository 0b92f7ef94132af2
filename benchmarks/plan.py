"""Time and memory of planning, driving and opening large data sets: python -m benchmarks.plan.

Each case runs in a process of its own: its CPU time, its wall time, and the growth of its peak
resident memory. The data set to open has the manifest of a real frame, again and again with other
indices, and no images; it is written to --folder (1.7 kB a frame) and removed.

How many cores a driver keeps busy is the CPU time of a worker for a chunk over the driver's, the
slope between two real runs of kinect-v2-paper, 128 x 128 pixels: more cores than that would wait
for the driver. It is a ratio, so that the machine's speed matters less.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

#: Frames that are planned to measure how many a driver hands out in a second.
HANDED_OUT = 9_600


def peak_mb() -> float:
    """Return the peak resident memory of this process, MB. Needs Linux.

    It is read from /proc: getrusage counts the memory of the parent process too.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


def measured(work: Callable[[], object]) -> dict[str, float]:
    """Call ``work``: seconds of CPU and of wall time, and MB by which the peak memory grew."""
    before = peak_mb()
    cpu, wall = time.process_time(), time.perf_counter()
    result = work()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    grown = peak_mb() - before
    del result
    return {"cpu_s": cpu, "wall_s": wall, "grown_mb": grown, "before_mb": before}


def plan_case(people: int, frames: int) -> dict[str, float]:
    """Plan, cut into chunks, hash, and make the tasks of one chunk."""
    from glsim.dataset.chunks import ChunkPlan
    from glsim.pipeline import open_sources
    from glsim.plan.tasks import make_tasks
    from glsim.settings.schema import load_settings

    source = {"kind": "procedural", "subjects": people, "frames_per_subject": frames}
    settings = load_settings(overrides={"source": source})
    sources = open_sources(settings)

    def work() -> object:
        chunks = ChunkPlan(make_tasks(settings, sources), 32)
        chunks.fingerprint()
        return chunks, chunks[len(chunks) // 2]

    return measured(work)


def chunks_case(people: int, frames: int, chunk_frames: int) -> dict[str, float]:
    """Make chunks and the messages that send them to workers: what the driver does for each."""
    import pickle

    from glsim.dataset.chunks import ChunkPlan
    from glsim.pipeline import open_sources
    from glsim.plan.tasks import make_tasks
    from glsim.settings.schema import load_settings

    source = {"kind": "procedural", "subjects": people, "frames_per_subject": frames}
    settings = load_settings(overrides={"source": source})
    chunks = ChunkPlan(make_tasks(settings, open_sources(settings)), chunk_frames)

    def work() -> object:
        numbers = range(HANDED_OUT // chunk_frames)
        return sum(len(pickle.dumps(chunks[number])) for number in numbers)

    return measured(work)


def driver_case(frames: int, chunk_frames: int) -> dict[str, float]:
    """Make a data set with two workers: CPU seconds of the driver and of the workers."""
    from glsim.dataset import generate
    from glsim.settings.schema import load_settings

    source = {"kind": "procedural", "subjects": frames // 32, "frames_per_subject": 32}
    output = {"crop": 128, "format": "png" if chunk_frames == 32 else "webdataset"}
    settings = load_settings(
        overrides={"sensor": "kinect-v2-paper", "output": output}, source=source
    )
    with tempfile.TemporaryDirectory() as folder:
        case = measured(lambda: generate(settings, Path(folder) / "data", workers=2))
    worker = resource.getrusage(resource.RUSAGE_CHILDREN)
    return case | {"worker_s": worker.ru_utime + worker.ru_stime}


def open_case(folder: Path) -> dict[str, float]:
    """Open a data set and read its middle record."""
    from glsim.dataset import open_dataset

    def work() -> object:
        dataset = open_dataset(folder)
        return dataset, dataset.pair(len(dataset) // 2)

    return measured(work)


def write_set(folder: Path, frames: int, people: int = 10_000) -> None:
    """Write the header and manifest of a data set of ``frames`` frames; all records are alike."""
    from glsim.dataset import generate
    from glsim.files.atomic import AtomicFile
    from glsim.settings.schema import load_settings

    source = {"kind": "procedural", "subjects": 1, "frames_per_subject": 1}
    generate(load_settings(overrides={"source": source}), folder, workers=1)
    header = json.loads((folder / "dataset.json").read_text())
    record = json.loads((folder / "manifest.jsonl").read_text())
    text = json.dumps(record | {"index": 77_777_777, "subject": "p7777777"})
    with AtomicFile(folder / "manifest.jsonl") as file:
        lines: list[str] = []
        for index in range(frames):
            line = text.replace("77777777", str(index)).replace("p7777777", f"p{index % people}")
            lines.append(line + "\n")
            if len(lines) == 10_000 or index == frames - 1:
                file.write("".join(lines).encode())
                lines.clear()
    header["files"] = {"manifest.jsonl": file.checksum}
    header["frames"]["train"] = frames
    header["subjects"]["train"] = [f"p{number}" for number in range(people)]
    (folder / "dataset.json").write_text(json.dumps(header, indent=1))
    (folder / ".glsim" / "chunks.jsonl").unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description="Planning and opening of large data sets.")
    parser.add_argument("--frames", type=int, default=10_000_000, help="Frames to plan.")
    parser.add_argument(
        "--open", type=int, default=1_000_000, help="Frames of the set to open; 0: none."
    )
    parser.add_argument("--folder", type=Path, help="Where to write that set. Default: /tmp.")
    parser.add_argument("--case", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        kind, *values = arguments.case
        if kind == "open":
            case = open_case(Path(values[0]))
        else:
            cases: dict[str, Callable[..., dict[str, float]]] = {
                "plan": plan_case,
                "chunks": chunks_case,
                "driver": driver_case,
            }
            case = cases[kind](*map(int, values))
        print(json.dumps(case))
        return
    out = Console(soft_wrap=True)

    def run(title: str, *words: str) -> dict[str, float]:
        command = [sys.executable, "-m", "benchmarks.plan", "--case", *words]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        case = json.loads(done.stdout)
        out.print(
            f"{title}: {case['cpu_s']:.2f} s of CPU ({case['wall_s']:.2f} s), "
            f"{case['grown_mb']:.0f} MB above the {case['before_mb']:.0f} MB of the imports"
        )
        return dict(case)

    for people in (10, 1_000, 100_000):
        each = arguments.frames // people
        run(f"plan of {people} people x {each} frames", "plan", str(people), str(each))
    for size in (32, 512):
        case = run(f"{HANDED_OUT} frames in chunks of {size}", "chunks", "1000", "1000", str(size))
        rate = HANDED_OUT / case["cpu_s"]
        out.print(f"  a driver hands out {rate:.0f} frames/s, {rate / size:.0f} chunks/s")
    for size in (32, 512):
        short, long = (
            run(f"driver of {frames} frames in chunks of {size}", "driver", str(frames), str(size))
            for frames in (512, 1536)
        )
        worker_s, driver_s = long["worker_s"] - short["worker_s"], long["cpu_s"] - short["cpu_s"]
        out.print(f"  keeps {worker_s / driver_s:.0f} cores busy")
    if not arguments.open:
        return
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        folder = Path(name) / "set"
        write_set(folder, arguments.open)
        size_gb = (folder / "manifest.jsonl").stat().st_size / 1e9
        title = f"opening {arguments.open} frames ({size_gb:.2f} GB of manifest)"
        for _ in range(2):
            run(title, "open", str(folder))


if __name__ == "__main__":
    main()
