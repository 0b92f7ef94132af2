"""A run: survey what is there, render what is missing, merge. The same call resumes it."""

from __future__ import annotations

import json
import logging
import os
import resource
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from glsim.config import Settings
from glsim.dataset.files import read_json, writing
from glsim.dataset.layout import CHUNK_FRAMES, FORMAT, FORMAT_VERSION, HEADER, SKIPPED, Chunk, Plan
from glsim.dataset.merge import merge, merged_chunks, merged_is_intact, unmerge
from glsim.dataset.pool import WorkerPool
from glsim.dataset.record import ChunkSummary
from glsim.dataset.store import Store
from glsim.dataset.work import Event, FrameMaker, Job, render
from glsim.errors import ConfigError, DatasetError
from glsim.plan import Task, make_tasks
from glsim.reason import Reason

log = logging.getLogger(__name__)

Workers = int | Literal["auto"]

#: Seconds between two calls of ``progress``.
_PROGRESS_EVERY_S = 0.1

_UNITS = {
    "clean, noisy": "uint16 steps of depth_unit_mm along the optical axis, 0 = no return; "
    "add depth_offset_mm of the record",
    "infrared": "uint16 counts",
    "reason": "uint8 codes, see reasons",
    "intrinsics": "pixels; the centre of the first pixel is at (0.5, 0.5)",
    "time_s": "seconds since the start of the sequence",
    "seeds": "64 bits as hexadecimal digits",
}


@dataclass(frozen=True)
class Progress:
    """Where a run stands. ``done`` frames of ``total`` include skipped and reused ones.

    skipped: could not be made. reused: were complete from an earlier run. bytes: of images.
    """

    done: int
    total: int
    skipped: int
    reused: int
    bytes: int


@dataclass(frozen=True)
class Summary:
    """What a run did and what the data set holds.

    frames: by split. subjects: number by split. skipped: reason -> frames.
    rendered, reused: frames (with skipped ones) of this run and of earlier ones. bytes: of images.
    seconds: wall time; cpu_seconds: of this process and its workers.
    """

    frames: Mapping[str, int]
    subjects: Mapping[str, int]
    skipped: Mapping[str, int]
    rendered: int
    reused: int
    bytes: int
    seconds: float
    cpu_seconds: float


@dataclass
class _Tally:
    total: int
    report: Callable[[Progress], None] | None
    frames: int = 0
    skipped: int = 0
    reused: int = 0
    bytes: int = 0
    begun: dict[int, int] = field(default_factory=dict)  # chunk in work -> frames
    reported: float = 0.0

    def complete(self, summary: ChunkSummary, *, reused: bool = False) -> None:
        self.begun.pop(summary.chunk, None)
        self.frames += summary.frames
        self.skipped += summary.skipped
        self.reused += summary.total if reused else 0
        self.bytes += summary.bytes
        self.show()

    def show(self, *, last: bool = False) -> None:
        now = time.monotonic()
        if self.report is None or (not last and now - self.reported < _PROGRESS_EVERY_S):
            return
        self.reported = now
        done = self.frames + self.skipped + sum(self.begun.values())
        self.report(Progress(done, self.total, self.skipped, self.reused, self.bytes))


def available_workers(workers: Workers = "auto") -> int:
    """The number of worker processes; "auto" is the number of cores that this process may use."""
    if workers == "auto":
        # Where the system cannot say which cores are ours (macOS), all are.
        affinity = getattr(os, "sched_getaffinity", None)
        return len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    if workers < 1:
        raise ConfigError(f"workers = {workers}: at least one is needed")
    return workers


def generate(
    settings: Settings,
    out: Path,
    *,
    workers: Workers = "auto",
    backend: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Make the data set that ``settings`` describe in the folder ``out``; again to resume.

    The same settings on the same renderer give the same bytes. backend: "egl" or "osmesa".
    Raises what ``write_dataset`` and ``glsim.pipeline.simulate`` raise.
    """
    # Here, because reading a data set needs no OpenGL.
    from glsim.gl.context import describe, open_context
    from glsim.pipeline import open_sources, simulate
    from glsim.regions import region_numbers
    from glsim.sensor import sensor_of

    sensor = sensor_of(settings)
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    context = open_context(backend)
    renderer = describe(context)["renderer"]
    context.release()
    return write_dataset(
        settings,
        tasks,
        out,
        partial(simulate, sources=sources, backend=backend, layers=settings.output.layers),
        sensor=sensor.describe(),
        renderer=renderer,
        regions=region_numbers(sources) if "regions" in settings.output.layers else {},
        workers=workers,
        progress=progress,
    )


def write_dataset(
    settings: Settings,
    tasks: Sequence[Task],
    out: Path,
    make_frames: FrameMaker,
    *,
    sensor: Mapping[str, Any],
    renderer: str,
    regions: Mapping[str, int] | None = None,
    workers: Workers = "auto",
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Make the data set of ``tasks`` in the folder ``out``, or what is still missing of it.

    What is there is verified by size and CRC32; missing and damaged files are made again. However
    often a run was interrupted, and with any number of workers, the same bytes result.

    make_frames: see FrameMaker. sensor, renderer: descriptions for the header; a run that is
    resumed must have the same ones. regions: name -> number in the layer of that name.
    workers: processes; 1 renders in this one.

    Raises ConfigError if the folder was begun with other settings, DatasetError if it is in use,
    cannot be written, or holds something else, or if worker processes die; MeshError at the first
    bad mesh if the settings are strict; KeyboardInterrupt after ending the workers. After any of
    these the same call continues.
    """
    started, cpu_started = time.monotonic(), _cpu_seconds()
    count = available_workers(workers)
    plan = Plan(tasks, CHUNK_FRAMES[settings.output.format])
    identity = _identity(settings, plan, sensor, renderer)
    if regions:
        identity["regions"] = dict(regions)  # uint8 numbers in the layer regions; 0 = none
    store = Store(out)
    tally = _Tally(len(tasks), progress)
    with store.opened(identity):
        missing = _survey(store, plan, tally)
        # Closed before the lock is released, so that no worker outlives it.
        with closing(_render(Job(settings, out, make_frames), plan, missing, count)) as events:
            for event in events:
                if isinstance(event, ChunkSummary):
                    tally.complete(event)
                else:
                    tally.begun[event.chunk] = event.frames
                    tally.show()
        if not store.is_merged:
            merge(store, plan, identity)
        header = read_json(out / HEADER)
        reasons = _skip_reasons(out / SKIPPED)
        tally.show(last=True)
    return Summary(
        frames=header["frames"],
        subjects={split: len(names) for split, names in header["subjects"].items()},
        skipped=reasons,
        rendered=tally.frames + tally.skipped - tally.reused,
        reused=tally.reused,
        bytes=tally.bytes,
        seconds=time.monotonic() - started,
        cpu_seconds=_cpu_seconds() - cpu_started,
    )


def _identity(
    settings: Settings, plan: Plan, sensor: Mapping[str, Any], renderer: str
) -> dict[str, Any]:
    """What determines the bytes of the data set, and how to read them."""
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "glsim_version": version("glsim"),
        "settings": settings.model_dump(mode="json", exclude_none=True),
        "sensor": dict(sensor),
        "renderer": renderer,
        "planned_frames": plan.frames,
        "plan": plan.fingerprint(),
        "depth_unit_mm": settings.output.depth_unit_mm,
        "units": _UNITS,
        "reasons": {str(int(r)): {"name": r.name.lower(), "help": r.help} for r in Reason},
    }


def _survey(store: Store, plan: Plan, tally: _Tally) -> Sequence[int]:
    """The numbers of the chunks that must be rendered: all that are not there, intact.

    A complete data set with any damage becomes a begun one.
    """
    merged = store.is_merged
    missing: list[int] = []
    for chunk, record in zip(plan, _records(store, plan), strict=True):
        problem = "its record is damaged" if merged else None
        if record is not None:
            problem = store.chunk_problem(record, chunk)
            if problem is None:
                tally.complete(record.summary, reused=True)
                continue
        missing.append(chunk.number)
        if problem is not None:
            first = chunk.tasks[0].stem
            log.warning("%s: rendering %s and the next frames again", problem, first)
    if merged:
        if missing or not merged_is_intact(store, len(plan)):
            unmerge(store, len(plan), set(missing))
        else:
            store.discard_chunks()  # left if the last run was killed at its very end
    return missing


def _records(store: Store, plan: Plan) -> Iterator[Any]:
    if store.is_merged:
        yield from merged_chunks(store, len(plan))
        return
    for number in range(len(plan)):
        try:
            yield store.load(number)
        except DatasetError as error:
            log.warning("%s: rendering it again", error)
            yield None


def _render(
    job: Job, plan: Plan, missing: Sequence[int], count: int
) -> Generator[Event, None, None]:
    chunks: Iterable[Chunk] = (plan[number] for number in missing)
    count = min(count, len(missing))
    if count == 1:
        yield from render(job, chunks)
    elif count > 1:
        with WorkerPool(job, count) as pool:
            yield from pool.render(chunks)


def _skip_reasons(path: Path) -> Counter[str]:
    with writing(path), path.open(encoding="utf-8") as lines:
        return Counter(json.loads(line)["why"] for line in lines)


def _cpu_seconds() -> float:
    """Of this process and of all its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
