"""The steps of a run: which chunks are missing, render them, merge their records.

``write_dataset`` takes all steps under the folder's lock. Parts take the first two, each under a
lock of its own, and whoever finds all records merges; another way to distribute chunks is a
``ChunkRenderer``.
"""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from glsim.dataset.chunk_writer import ChunkEvent, FrameMaker, RenderJob, render_chunks
from glsim.dataset.chunks import CHUNK_FRAMES, Chunk, ChunkPlan
from glsim.dataset.cloud_output import open_output
from glsim.dataset.disk_format import HEADER, SKIPPED
from glsim.dataset.identity import Inputs, make_identity
from glsim.dataset.merge import merge, merged_files_are_intact, read_merged_chunks, unmerge
from glsim.dataset.output_folder import OutputFolder
from glsim.dataset.parts import Part
from glsim.dataset.progress import GenerateSummary, RunCounts
from glsim.dataset.records import ChunkRecord, ChunkSummary
from glsim.dataset.worker_pool import WorkerPool
from glsim.errors import ConfigError, DatasetError
from glsim.files.atomic import read_json, wrap_write_errors
from glsim.files.cloud import cloud_url
from glsim.plan.tasks import Task
from glsim.settings.schema import Settings

log = logging.getLogger(__name__)

#: Renders and writes chunks, in any order, and yields their events. It is closed before the lock
#: is released: nothing that it started may write afterwards.
ChunkRenderer = Callable[[RenderJob, Sequence[int], ChunkPlan], Generator[ChunkEvent, None, None]]


def in_processes(count: int, environment: Mapping[str, str] | None = None) -> ChunkRenderer:
    """Return the renderer that uses worker processes; with 1 it renders in this process.

    environment: variables for the workers. With any, one worker is a process too: NumPy and
    OpenBLAS read them when they are loaded.
    """

    def render(
        job: RenderJob, numbers: Sequence[int], plan: ChunkPlan
    ) -> Generator[ChunkEvent, None, None]:
        chunks: Iterable[Chunk] = (plan[number] for number in numbers)
        processes = min(count, len(numbers))
        if processes == 1 and not environment:
            yield from render_chunks(job, chunks)
        elif processes:
            with WorkerPool(job, processes, environment) as pool:
                yield from pool.render_chunks(chunks)

    return render


@dataclass(frozen=True)
class DatasetRun:
    """What is made, and where. The fields are the arguments of ``write_dataset``."""

    settings: Settings
    tasks: Sequence[Task]
    out: Path | str
    make_frames: FrameMaker
    sensor: Mapping[str, Any]
    renderer: str
    regions: Mapping[str, int] | None = None
    inputs: Callable[[], Inputs] | None = None
    part: Part | None = None
    plan: ChunkPlan = field(init=False)

    def __post_init__(self) -> None:
        if cloud_url(self.out) is not None and self.settings.output.format != "webdataset":
            raise ConfigError(
                f"{self.out}: object storage takes shards: give --format webdataset "
                "(output.format), or a folder"
            )
        plan = ChunkPlan(self.tasks, CHUNK_FRAMES[self.settings.output.format])
        object.__setattr__(self, "plan", plan)

    @cached_property
    def found(self) -> Inputs | None:
        """The inputs as they were at the first use."""
        return self.inputs() if self.inputs is not None else None

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What decides the bytes of the data set, see ``glsim.dataset.identity``."""
        identity = make_identity(self.settings, self.plan, self.sensor, self.renderer)
        if self.regions:
            identity["regions"] = dict(self.regions)  # pixel values of the layer; 0 = none
        if self.found is not None:
            identity["inputs"] = self.found.identity()
        return identity

    @cached_property
    def folder(self) -> OutputFolder:
        """The folder ``out``, on disk or in object storage."""
        return open_output(self.out, self.part)

    @property
    def numbers(self) -> range:
        """The numbers of the chunks to make: all, or those of the part."""
        chunks = len(self.plan)
        return range(chunks) if self.part is None else self.part.chunks(chunks)

    @cached_property
    def frames(self) -> int:
        """The number of frames in these chunks."""
        if self.part is None:
            return self.plan.frames
        return sum(self.plan.frames_in(number) for number in self.numbers)


def make_missing_chunks(run: DatasetRun, render: ChunkRenderer, counts: RunCounts) -> None:
    """Render the chunks that the folder lacks. Raises as ``write_dataset``.

    The caller holds the lock of the folder, or of the part.
    """
    missing = find_missing_chunks(run, counts)
    job = RenderJob(run.settings, run.folder, run.make_frames, run.found)
    with closing(render(job, missing, run.plan)) as events:
        for event in events:
            if isinstance(event, ChunkSummary):
                counts.complete(event)
            else:
                counts.in_progress[event.chunk] = event.frames
                counts.report()
    if run.inputs is not None and run.found is not None and missing:
        now = run.inputs()
        if now != run.found:  # some of this run's frames are of the old contents, some of the new
            run.folder.discard_chunks(missing)
            raise DatasetError(
                f"{now.changed_since(run.found)} was changed during the run, and the frames of "
                "this run are discarded: restore it, or choose another folder"
            )


def find_missing_chunks(run: DatasetRun, counts: RunCounts) -> list[int]:
    """Return the numbers of the chunks that are missing or damaged, and count the others.

    A complete data set with any damage is turned back into a resumable one.
    """
    folder, plan = run.folder, run.plan
    merged = folder.is_merged
    missing: list[int] = []
    for number, record in zip(run.numbers, _chunk_records(run), strict=True):
        problem = "its record is damaged" if merged else None
        if record is not None:
            problem = folder.chunk_problem(record, number, plan.frames_in(number))
            if problem is None:
                counts.complete(record.summary, reused=True)
                continue
        missing.append(number)
        if problem is not None:
            first = plan[number].tasks[0].stem
            log.warning("%s: rendering %s and the next frames again", problem, first)
    if merged:
        if missing or not merged_files_are_intact(folder, len(plan)):
            unmerge(folder, len(plan), set(missing))
        else:
            folder.discard_chunk_records()  # left over if the last run was killed at its very end
    return missing


def _chunk_records(run: DatasetRun) -> Iterator[ChunkRecord | None]:
    """Yield the record of each chunk to make, in order; None if it is missing or damaged."""
    if run.folder.is_merged:
        yield from read_merged_chunks(run.folder, len(run.plan))
        return
    recorded = run.folder.recorded_chunks()
    for number in run.numbers:
        try:
            yield run.folder.load_chunk(number) if number in recorded else None
        except DatasetError as error:
            log.warning("%s: rendering it again", error)
            yield None


def absent_chunks(folder: OutputFolder, plan: ChunkPlan) -> list[int]:
    """Return the numbers of all chunks that have no record, of any part; [] in a merged folder."""
    recorded = folder.recorded_chunks()
    if folder.is_merged:  # asked last: another part may merge, which removes the records
        return []
    return [number for number in range(len(plan)) if number not in recorded]


def finish(
    folder: OutputFolder, plan: ChunkPlan, identity: Mapping[str, Any], counts: RunCounts
) -> GenerateSummary:
    """Merge the chunk records, unless that is done. The caller holds the folder's lock."""
    if not folder.is_merged:
        merge(folder, plan, identity)
    folder.discard_part_files()
    header = read_json(folder.out / HEADER)
    reasons = _skip_reasons(folder.out / SKIPPED)
    counts.report(last=True)
    return GenerateSummary(
        frames=header["frames"],
        subjects={split: len(names) for split, names in header["subjects"].items()},
        skipped=reasons,
        rendered=counts.rendered,
        reused=counts.reused,
        bytes=counts.bytes,
        seconds=counts.seconds,
        cpu_seconds=counts.cpu_seconds,
    )


def _skip_reasons(path: Path) -> Counter[str]:
    """Count the skipped frames by reason."""
    with wrap_write_errors(path), path.open(encoding="utf-8") as lines:
        return Counter(json.loads(line)["why"] for line in lines)
