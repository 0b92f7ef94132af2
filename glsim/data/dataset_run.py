"""The steps of a run: find missing chunks, render them, and merge their records.

``write_dataset`` takes frames of any frame maker; ``glsim.data.driver`` simulates them. ``run_all``
does all steps under the lock of the data set. Parts (``run_part``) do the first two steps under
separate locks; the part that finds all records merges them.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import parse_json
from glsim.core.files.cloud import open_store
from glsim.core.files.store import Store
from glsim.data.chunk_writer import ChunkEvent, FrameMaker, RenderJob
from glsim.data.chunks import CHUNK_FRAMES, ChunkPlan, Part
from glsim.data.disk_format import HEADER, SKIPPED
from glsim.data.header import simulated_by
from glsim.data.merge import bounded_lines, merge, merged_files_are_intact
from glsim.data.progress import GenerateSummary, PartSummary, Progress, RunCounts
from glsim.data.record_schema import MAX_HEADER_BYTES, MAX_LINE_BYTES, parse_header
from glsim.data.records import ChunkRecord, ChunkSummary
from glsim.data.run_identity import InputHashes, make_identity
from glsim.data.state_folder import RunState
from glsim.data.worker_processes import Workers, available_workers, run_tasks
from glsim.settings.schema import Settings
from glsim.simulation.plan.tasks import Task

log = logging.getLogger(__name__)

#: A function that renders and writes chunks in any order, and yields their events. The generator is
#: closed before the lock is released, and must not write afterwards.
ChunkRenderer = Callable[[RenderJob, Sequence[int], ChunkPlan], Generator[ChunkEvent, None, None]]


def in_processes(count: int, environment: Mapping[str, str] | None = None) -> ChunkRenderer:
    """Return a chunk renderer that uses ``count`` worker processes."""

    def render(
        job: RenderJob, numbers: Sequence[int], plan: ChunkPlan
    ) -> Generator[ChunkEvent, None, None]:
        if numbers:
            chunks = (plan[number] for number in numbers)
            yield from run_tasks(job, chunks, min(count, len(numbers)), environment)

    return render


@dataclass(frozen=True)
class DatasetRun:
    """A data set to make, with its store; the fields are arguments of ``write_dataset``."""

    settings: Settings
    tasks: Sequence[Task]
    store: Store
    make_frames: FrameMaker
    sensor: Mapping[str, Any]
    renderer: str
    regions: Mapping[str, int] | None = None
    inputs: Callable[[], InputHashes] | None = None
    plan: ChunkPlan = field(init=False)

    def __post_init__(self) -> None:
        if self.store.is_remote and self.settings.output.format != "webdataset":
            raise ConfigError(
                f"{self.store}: object storage takes shards: set "
                "output.format=webdataset, or give a folder"
            )
        output = self.settings.output
        plan = ChunkPlan(self.tasks, output.frames_per_shard or CHUNK_FRAMES[output.format])
        object.__setattr__(self, "plan", plan)

    @cached_property
    def found(self) -> InputHashes | None:
        """Hashes of the inputs, computed at the first access."""
        return self.inputs() if self.inputs is not None else None

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Header entries that decide the bytes, see ``glsim.data.run_identity``."""
        identity = make_identity(self.settings, self.plan, self.sensor, self.renderer)
        if self.regions:
            identity["regions"] = dict(self.regions)  # pixel values of the layer; 0 = none
        if self.found is not None:
            identity["inputs"] = self.found.identity()
        return identity

    @property
    def state(self) -> RunState:
        """State folder of the data set; changes need ``RunState.locked``."""
        return RunState(self.store)

    def numbers(self, part: Part | None) -> range:
        """Return the chunk numbers of a part, or of the whole data set for None."""
        chunks = len(self.plan)
        return range(chunks) if part is None else part.chunks(chunks)

    def counts(self, part: Part | None = None, progress: Progress | None = None) -> RunCounts:
        """Return new counters for the frames of a part, or of the whole data set."""
        if part is None:
            return RunCounts(self.plan.frames, progress)
        return RunCounts(sum(map(self.plan.frames_in, self.numbers(part))), progress)


def run_all(run: DatasetRun, render: ChunkRenderer, progress: Progress | None) -> GenerateSummary:
    """Make all chunks of a data set with ``render``, holding its lock, and merge them."""
    counts = run.counts(progress=progress)
    with run.state.locked(run.identity) as state:
        make_missing_chunks(run, state, None, render, counts)
        return finish(state, run.plan, run.identity, counts)


def make_missing_chunks(
    run: DatasetRun, state: RunState, part: Part | None, render: ChunkRenderer, counts: RunCounts
) -> None:
    """Render the missing and damaged chunks. Raises the errors of ``write_dataset``."""
    missing = _find_missing_chunks(run, state, run.numbers(part), counts)
    sensor = Path(simulated_by(run.identity)).stem
    job = RenderJob(run.settings, state, run.make_frames, run.found, sensor)
    with closing(render(job, missing, run.plan)) as events:
        for event in events:
            if isinstance(event, ChunkSummary):
                counts.complete(event)
            else:
                counts.nodes_cpu_s += event.cpu_s
                counts.in_progress[event.chunk] = event.frames
                counts.report()
    if run.inputs is not None and run.found is not None and missing:
        now = run.inputs()
        if now != run.found:  # inputs changed during the run
            state.discard_chunks(missing)
            raise DatasetError(
                f"{now.changed_since(run.found)} was changed during the run, and the frames of "
                "this run are discarded: restore it, or choose another folder"
            )


def _find_missing_chunks(
    run: DatasetRun, state: RunState, numbers: range, counts: RunCounts
) -> list[int]:
    """Return the numbers of missing and damaged chunks; count the others as reused."""
    plan, recorded = run.plan, state.recorded_chunks()

    def load(number: int) -> ChunkRecord | None:
        try:
            return state.load_chunk(number) if number in recorded else None
        except DatasetError as error:
            log.warning("%s: rendering it again", error)
            return None

    def check(number: int) -> tuple[int, ChunkRecord | None, str | None]:
        record = load(number)
        if record is None:
            return number, None, None
        return number, record, state.chunk_problem(record, number, plan.frames_in(number))

    missing: list[int] = []
    for number, record, problem in state.store.map(check, numbers):
        if record is not None and problem is None:
            counts.complete(record.summary, reused=True)
            continue
        missing.append(number)
        if problem is not None:
            first = plan[number].tasks[0].stem
            log.warning("%s: rendering %s and the next frames again", problem, first)
    if state.is_merged and (missing or not merged_files_are_intact(state)):
        state.withdraw()
    return missing


def run_part(
    run: DatasetRun, part: Part, render: ChunkRenderer, progress: Progress | None
) -> PartSummary:
    """Make the chunks of a part with ``render``; then merge if no chunk of the set is missing."""
    counts = run.counts(part, progress)
    with run.state.locked(run.identity, part=part) as state:
        state.note_parts(part.of, len(run.plan))
        make_missing_chunks(run, state, part, render, counts)
    counts.report(last=True)
    # This part's lock is free now. The part that completed the last chunk sees all records and
    # merges. If two parts end together, both try, and the second finds the merge done.
    missing, whole = run.state.missing_parts(), None
    if len(run.state.recorded_chunks()) == len(run.plan):
        with run.state.locked(run.identity, wait=True) as state:
            whole = finish(state, run.plan, run.identity, run.counts())
    done = (counts.frames, counts.skipped, counts.rendered, counts.reused, counts.seconds)
    return PartSummary(part, *done, missing=missing, dataset=whole)


def finish(
    state: RunState, plan: ChunkPlan, identity: Mapping[str, Any], counts: RunCounts
) -> GenerateSummary:
    """Merge the chunk records of a locked data set if necessary; return the summary of the run."""
    if not state.is_merged:
        merge(state, plan, identity)
    state.discard_part_files()
    store = state.store
    header = parse_header(store.read(HEADER, MAX_HEADER_BYTES) or b"", store.where(HEADER))
    with store.open(SKIPPED) as lines:
        records = (parse_json(line, SKIPPED) for line in bounded_lines(lines, MAX_LINE_BYTES))
        reasons = Counter(str(record.get("why")) for record in records)
    counts.report(last=True)
    return GenerateSummary(
        frames=header["frames"],
        subjects={split: len(names) for split, names in header["subjects"].items()},
        skipped=reasons, rendered=counts.rendered, reused=counts.reused, bytes=counts.bytes,
        seconds=counts.seconds, cpu_seconds=counts.cpu_seconds,
    )  # fmt: skip


def write_dataset(
    settings: Settings,
    tasks: Sequence[Task],
    out: Path | str,
    make_frames: FrameMaker,
    *,
    sensor: Mapping[str, Any],
    renderer: str,
    regions: Mapping[str, int] | None = None,
    inputs: Callable[[], InputHashes] | None = None,
    workers: Workers = "auto",
    progress: Progress | None = None,
) -> GenerateSummary:
    """Write the data set of ``tasks`` to the folder ``out``, or the frames missing there.

    Existing files are verified by size and CRC32; missing and damaged files are made again. The
    bytes are the same for any number of workers and interruptions.

    Raises ConfigError if the folder was begun with other settings or inputs; DatasetError if it is
    in use, cannot be written, or holds other files, if worker processes die, or if an input changes
    during the run; MeshError at the first bad mesh if the settings are strict; KeyboardInterrupt
    after ending the workers. After any of these, the same call continues the run.

    Args:
        sensor, renderer: descriptions for the header, equal in a resumed run.
        regions: name -> number in the layer "regions".
        inputs: hashes the files that the settings name, equal in a resumed run.
        workers: number of processes; 1 renders in this process.
    """
    store = open_store(out)
    run = DatasetRun(settings, tasks, store, make_frames, sensor, renderer, regions, inputs)
    return run_all(run, in_processes(available_workers(workers)), progress)
