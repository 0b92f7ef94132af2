"""A fast, deterministic fake of the simulator, which can fail at a chosen frame."""

import json
import os
import signal
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.errors import AccessError, MeshError
from glsim.core.files import atomic
from glsim.core.files.atomic import checksum, file_checksum
from glsim.core.rect import Rect
from glsim.core.seeds import stable_seed
from glsim.data.dataset_run import write_dataset
from glsim.data.progress import GenerateSummary
from glsim.faces.face_source import FaceKey
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.tasks import Task

CAMERA = Intrinsics(32, 24, 40.0, 40.0, 16.0, 12.0)
WINDOW = Rect(4, 2, 20, 18)
SENSOR = {"name": "fake", "stages": [{"name": "noise", "sigma_mm": 2.0}]}
#: The file of a real sensor without noise, of small frames.
TINY_SENSOR = """
title = "tiny"
[rig]
width = 48
height = 40
focal_px = [60, 60]
centre_px = [24, 20]
"""
FORMATS = ["png", "webdataset"]
#: Faults of `fake_frames`: every seventh face is a bad one.
SKIP: dict[str, Any] = {"skip_every": 7}


def make_settings(**output: Any) -> Settings:
    return load_settings(overrides={"output": output, "source": {"kind": "procedural"}})


def make_tasks(subjects: int = 8, frames: int = 20) -> list[Task]:
    splits = ["train", "test", "train", "val"]
    tasks: list[Task] = []
    for s in range(subjects):
        for f in range(frames):
            key = FaceKey(f"s{s:03d}", "smile.1", f, f / 30)
            seeds = ScopeSeeds(stable_seed(s, f), stable_seed(s), 2**64 - 1 - s)
            tasks.append(Task(len(tasks), splits[s % 4], f"s{s:03d}", 0, key, seeds, s % 2))
    return tasks


@dataclass(frozen=True)
class Fault:
    """A fault at the frame with a given index; with a path ``once`` it happens only once.

    kind: "kill", "mesh", "bug", "sleep", "lose" or "full". "full" puts the next temporary file
    for ``name`` in the folder ``out`` on a full disk.
    """

    kind: str
    index: int
    once: str = ""
    out: str = ""
    name: str = ".png"

    def strikes(self, index: int) -> bool:
        if index != self.index:
            return False
        if self.once:
            try:
                Path(self.once).touch(exist_ok=False)
            except FileExistsError:
                return False
        return True


def fake_frames(
    settings: Settings, tasks: Iterable[Task], faults: tuple[Fault, ...] = (), skip_every: int = 0,
    delay_s: float = 0.0, ahead: int = 3, refuse: str = "",
) -> Iterator[Frame | Skipped]:  # fmt: skip
    """Yield frames whose pixels depend only on the seed, taking ``ahead`` tasks at once.

    A process whose environment has the variable ``refuse`` makes none.
    """
    if refuse in os.environ:
        raise AccessError("s3://faces: access denied")
    tasks = iter(tasks)
    while batch := list(islice(tasks, ahead)):
        for task in batch:
            time.sleep(delay_s)
            for fault in faults:
                if fault.strikes(task.index):
                    strike(fault)
            if any(fault.kind == "lose" and fault.strikes(task.index) for fault in faults):
                continue
            if skip_every and task.index % skip_every == skip_every - 1:
                yield Skipped(task.key, "fake", "no face: try unit='cm'")
            else:
                yield fake_frame(task, settings.output.depth_unit_mm)


def strike(fault: Fault) -> None:
    if fault.kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if fault.kind == "mesh":
        raise MeshError("the mesh has a hole")
    if fault.kind == "bug":
        raise ZeroDivisionError("one by zero")
    if fault.kind == "sleep":
        time.sleep(0.5)
    if fault.kind == "full":
        put_on_full_disk(fault.out, fault.name)


def put_on_full_disk(out: str, name: str) -> None:
    """Let the next temporary file for ``name`` of data set ``out`` meet a full disk, once."""
    create = atomic._create

    def create_on_full_disk(temporary: Path) -> Any:
        file = create(temporary)
        if temporary.name.endswith(name) and temporary.is_relative_to(out):
            atomic._create = create
            file.close()
            return Path("/dev/full").open("wb")
        return file

    atomic._create = create_on_full_disk


def fake_frame(task: Task, unit_mm: float = 1.0, offset_mm: float = 0.0) -> Frame:
    rng = np.random.default_rng(task.seeds.frame)
    shape = (WINDOW.height, WINDOW.width)
    clean = rng.uniform(0.8, 1.0, shape).astype(np.float32)
    noisy = (clean + rng.normal(0, 0.002, shape)).astype(np.float32)
    noisy[rng.random(shape) < 0.1] = 0
    numpy_distance_mm: Any = np.float32(900)  # records must hold plain numbers
    return Frame(
        task.key,
        "fake",
        task.seeds.frame,
        CAMERA,
        WINDOW,
        clean,
        noisy,
        rng.uniform(0, 70000, shape).astype(np.float32),
        rng.integers(0, 12, shape).astype(np.uint8),
        expected_m=clean + np.float32(0.002),
        depth_unit_mm=unit_mm,
        depth_offset_mm=offset_mm,
        pose={"yaw_deg": float(rng.normal()), "distance_mm": numpy_distance_mm},
        expression={"smile": 0.5} if task.key.frame % 2 else {},
        parameters={"axial.sigma_mm": float(rng.uniform())},
        notes={"unit": "mm"},
    )


def make(
    out: Path | str, settings: Settings | None = None, tasks: list[Task] | None = None, *,
    workers: int = 1, progress: Any = None, renderer: str = "fake renderer", inputs: Any = None,
    **faults: Any,
) -> GenerateSummary:  # fmt: skip
    """Write a data set of fake frames."""
    return write_dataset(
        settings or make_settings(),
        make_tasks() if tasks is None else tasks,
        out,
        partial(fake_frames, **faults),
        sensor=SENSOR,
        renderer=renderer,
        inputs=inputs,
        workers=workers,
        progress=progress,
    )


def children() -> list[int]:
    """Return the process numbers of this process's children."""
    tasks = Path("/proc/self/task").glob("*/children")
    return [int(pid) for task in tasks for pid in task.read_text().split()]


def contents(out: Path) -> dict[str, bytes]:
    """Read every file of a folder except the lock: relative name -> bytes."""
    files = (path for path in out.rglob("*") if path.is_file() and path.name != "lock")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def sign(out: Path, **changes: Any) -> None:
    """Change entries of dataset.json, and write the checksums of the files on disk into it."""
    header = json.loads((out / "dataset.json").read_text()) | changes
    if "manifest.jsonl" in header["files"]:
        header["files"]["manifest.jsonl"] = file_checksum(out / "manifest.jsonl")
    data = json.dumps(header).encode()
    (out / "dataset.json").write_bytes(data)
    (out / ".glsim" / "complete.json").write_text(json.dumps(checksum(data)))
