"""The driver of a run: survey the folder, render missing chunks, merge. It resumes any run."""

from __future__ import annotations

import json
import logging
import resource
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from glsim.dataset.chunk_writer import ChunkEvent, FrameMaker, RenderJob, render_chunks
from glsim.dataset.chunks import CHUNK_FRAMES, Chunk, ChunkPlan
from glsim.dataset.disk_format import HEADER, SKIPPED
from glsim.dataset.identity import Inputs, make_identity
from glsim.dataset.merge import merge, merged_files_are_intact, read_merged_chunks, unmerge
from glsim.dataset.output_folder import OutputFolder
from glsim.dataset.records import ChunkRecord, ChunkSummary
from glsim.dataset.worker_pool import WorkerPool
from glsim.errors import DatasetError
from glsim.files.atomic import read_json, wrap_write_errors
from glsim.plan.tasks import Task, make_tasks
from glsim.settings.schema import Settings
from glsim.worker_processes import Workers, available_workers

log = logging.getLogger(__name__)

#: Seconds between two calls of ``progress``.
_PROGRESS_EVERY_S = 0.1


@dataclass(frozen=True)
class GenerateProgress:
    """The state of a run. ``done`` of ``total`` frames include skipped and reused ones.

    skipped: frames that could not be made. reused: frames that an earlier run completed.
    bytes: size of all images.
    """

    done: int
    total: int
    skipped: int
    reused: int
    bytes: int


@dataclass(frozen=True)
class GenerateSummary:
    """The results of a run and the contents of the data set.

    frames, subjects: split -> number. skipped: reason -> number of frames.
    rendered, reused: frames of this run and of earlier ones, skipped frames included.
    bytes: size of all images. seconds: wall time. cpu_seconds: of this process and its workers.
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
class _RunCounts:
    """Counts frames and bytes, and passes them to ``callback``."""

    total: int
    callback: Callable[[GenerateProgress], None] | None
    frames: int = 0
    skipped: int = 0
    reused: int = 0
    bytes: int = 0
    in_progress: dict[int, int] = field(default_factory=dict)  # chunk number -> frames done
    reported_s: float = 0.0

    def complete(self, summary: ChunkSummary, *, reused: bool = False) -> None:
        self.in_progress.pop(summary.chunk, None)
        self.frames += summary.frames
        self.skipped += summary.skipped
        self.reused += summary.total if reused else 0
        self.bytes += summary.bytes
        self.report()

    def report(self, *, last: bool = False) -> None:
        now = time.monotonic()
        if self.callback is None or (not last and now - self.reported_s < _PROGRESS_EVERY_S):
            return
        self.reported_s = now
        done = self.frames + self.skipped + sum(self.in_progress.values())
        self.callback(GenerateProgress(done, self.total, self.skipped, self.reused, self.bytes))


def generate(
    settings: Settings,
    out: Path,
    *,
    workers: Workers = "auto",
    backend: str | None = None,
    progress: Callable[[GenerateProgress], None] | None = None,
) -> GenerateSummary:
    """Generate the data set that ``settings`` describe in the folder ``out``, or resume it.

    The same settings on the same renderer give the same bytes. backend: "egl" or "osmesa".
    Raises the errors of ``write_dataset`` and ``glsim.pipeline.simulate``.
    """
    # Imported here because reading a data set needs no OpenGL.
    from glsim.appearance.dress import worn_regions
    from glsim.dataset.arithmetic import fingerprint, simulate_alike
    from glsim.dataset.inputs import source_hashes, stage_hashes
    from glsim.faces.regions import region_numbers
    from glsim.gl.context import borrowed_context, describe
    from glsim.pipeline import open_sources
    from glsim.scene.scenery import scene_regions
    from glsim.sensors.sensor import sensor_of

    sensor = sensor_of(settings)
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    worn = worn_regions(settings.appearance, sources)
    with borrowed_context(backend) as context:
        renderer, arithmetic = describe(context)["renderer"], fingerprint(context)
    make_frames = partial(
        simulate_alike,
        arithmetic=arithmetic,
        sources=sources,
        backend=backend,
        layers=settings.output.layers,
    )

    def inputs() -> Inputs:
        return Inputs(stage_hashes(sensor.stages), source_hashes(sources, tasks), arithmetic)

    return write_dataset(
        settings,
        tasks,
        out,
        make_frames,
        sensor=sensor.describe(),
        renderer=renderer,
        regions=(
            region_numbers(sources, [*scene_regions(settings.scene), *worn])
            if "regions" in settings.output.layers
            else {}
        ),
        inputs=inputs,
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
    inputs: Callable[[], Inputs] | None = None,
    workers: Workers = "auto",
    progress: Callable[[GenerateProgress], None] | None = None,
) -> GenerateSummary:
    """Write the data set of ``tasks`` to the folder ``out``, or the frames that it still lacks.

    Existing files are verified by size and CRC32; missing and damaged files are made again. The
    bytes are the same for any number of workers and interruptions.

    make_frames: see FrameMaker. sensor, renderer: descriptions for the header; a resumed run must
    have the same ones. regions: name -> number in the layer "regions". inputs: hashes what the
    settings only name, as it is at the time of the call; a resumed run must have the same.
    workers: number of processes; 1 renders in this process.

    Raises ConfigError if the folder was begun with other settings or inputs; DatasetError if it is
    in use, cannot be written, or holds other files, if worker processes die, or if an input changes
    during the run; MeshError at the first
    bad mesh if the settings are strict; KeyboardInterrupt after ending the workers. After any of
    these, the same call continues the run.
    """
    started, cpu_started = time.monotonic(), _cpu_seconds()
    processes = available_workers(workers)
    plan = ChunkPlan(tasks, CHUNK_FRAMES[settings.output.format])
    identity = make_identity(settings, plan, sensor, renderer)
    if regions:
        identity["regions"] = dict(regions)  # pixel values of the layer "regions"; 0 = none
    found = inputs() if inputs is not None else None
    if found is not None:
        identity["inputs"] = found.identity()
    folder = OutputFolder(out)
    counts = _RunCounts(len(tasks), progress)
    with folder.locked(identity, found):
        missing = _find_missing_chunks(folder, plan, counts)
        job = RenderJob(settings, out, make_frames)
        # Closed before the lock is released: no worker outlives the lock.
        with closing(_render_missing(job, plan, missing, processes)) as events:
            for event in events:
                if isinstance(event, ChunkSummary):
                    counts.complete(event)
                else:
                    counts.in_progress[event.chunk] = event.frames
                    counts.report()
        if inputs is not None and found is not None and missing:
            now = inputs()
            if now != found:  # some of this run's frames are of the old contents, some of the new
                folder.discard_chunks(missing)
                raise DatasetError(
                    f"{now.changed_since(found)} was changed during the run, and the frames of "
                    "this run are discarded: restore it, or choose another folder"
                )
        if not folder.is_merged:
            merge(folder, plan, identity)
        header = read_json(out / HEADER)
        reasons = _skip_reasons(out / SKIPPED)
        counts.report(last=True)
    return GenerateSummary(
        frames=header["frames"],
        subjects={split: len(names) for split, names in header["subjects"].items()},
        skipped=reasons,
        rendered=counts.frames + counts.skipped - counts.reused,
        reused=counts.reused,
        bytes=counts.bytes,
        seconds=time.monotonic() - started,
        cpu_seconds=_cpu_seconds() - cpu_started,
    )


def _find_missing_chunks(
    folder: OutputFolder, plan: ChunkPlan, counts: _RunCounts
) -> Sequence[int]:
    """Return the numbers of the chunks that are missing or damaged, and count the others.

    A complete data set with any damage is turned back into a resumable one.
    """
    merged = folder.is_merged
    missing: list[int] = []
    for chunk, record in zip(plan, _chunk_records(folder, plan), strict=True):
        problem = "its record is damaged" if merged else None
        if record is not None:
            problem = folder.chunk_problem(record, chunk)
            if problem is None:
                counts.complete(record.summary, reused=True)
                continue
        missing.append(chunk.number)
        if problem is not None:
            first = chunk.tasks[0].stem
            log.warning("%s: rendering %s and the next frames again", problem, first)
    if merged:
        if missing or not merged_files_are_intact(folder, len(plan)):
            unmerge(folder, len(plan), set(missing))
        else:
            folder.discard_chunk_records()  # left over if the last run was killed at its very end
    return missing


def _chunk_records(folder: OutputFolder, plan: ChunkPlan) -> Iterator[ChunkRecord | None]:
    """Yield the record of each chunk in order; None if it is missing or damaged."""
    if folder.is_merged:
        yield from read_merged_chunks(folder, len(plan))
        return
    for number in range(len(plan)):
        try:
            yield folder.load_chunk(number)
        except DatasetError as error:
            log.warning("%s: rendering it again", error)
            yield None


def _render_missing(
    job: RenderJob, plan: ChunkPlan, missing: Sequence[int], processes: int
) -> Generator[ChunkEvent, None, None]:
    """Render the missing chunks in this process, or in worker processes."""
    chunks: Iterable[Chunk] = (plan[number] for number in missing)
    processes = min(processes, len(missing))
    if processes == 1:
        yield from render_chunks(job, chunks)
    elif processes > 1:
        with WorkerPool(job, processes) as pool:
            yield from pool.render_chunks(chunks)


def _skip_reasons(path: Path) -> Counter[str]:
    """Count the skipped frames by reason."""
    with wrap_write_errors(path), path.open(encoding="utf-8") as lines:
        return Counter(json.loads(line)["why"] for line in lines)


def _cpu_seconds() -> float:
    """Return the CPU seconds of this process and of all its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
