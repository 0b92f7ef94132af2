"""The run of one part of a data set, which merges all parts if it was the last one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from glsim.dataset.dataset_run import (
    ChunkRenderer,
    DatasetRun,
    absent_chunks,
    finish,
    is_complete_unwritten,
    make_missing_chunks,
    summary_of,
)
from glsim.dataset.parts import Part
from glsim.dataset.progress import GenerateSummary, PartSummary, Progress, RunCounts
from glsim.dataset.run_state import PartBusyError
from glsim.errors import DatasetError, DifferentMachineError


def run_part(
    run: DatasetRun,
    part: Part,
    render: ChunkRenderer,
    progress: Progress | None,
    *,
    leave: bool = False,
) -> PartSummary:
    """Make the chunks of a part with ``render``, and merge if no chunk is missing then."""
    counts = run.counts(part, progress)
    left, taken = "", []
    try:
        _make_part(run, part, render, counts)
        taken = _take_left_parts(run, render)
    except DifferentMachineError as error:
        if not leave:
            raise
        left = str(error)
        run.state.leave_part(part)
    except DatasetError as error:
        if not is_complete_unwritten(error, run.state, run.plan, run.identity, run.found):
            raise
        return _summary(part, counts, whole=summary_of(run.store, run.counts()))
    counts.report(last=True)
    # The part that completes the last chunk sees all records here, after its lock is free: two
    # parts that end together both come to this line, and the second finds the work done.
    absent = absent_chunks(run.state, run.plan)
    whole = None
    if not absent and not left:
        with run.state.locked(run.identity, run.found, wait=True) as state:
            whole = finish(state, run.plan, run.identity, run.counts())
    return _summary(part, counts, len(absent), whole, left, taken)


def _summary(
    part: Part,
    counts: RunCounts,
    absent: int = 0,
    whole: GenerateSummary | None = None,
    left: str = "",
    taken: Sequence[Part] = (),
) -> PartSummary:
    return PartSummary(
        part=part,
        frames=counts.frames,
        skipped=counts.skipped,
        rendered=counts.rendered,
        reused=counts.reused,
        bytes=counts.bytes,
        seconds=counts.seconds,
        cpu_seconds=counts.cpu_seconds,
        absent_chunks=absent,
        dataset=whole,
        left=left,
        taken=tuple(taken),
    )


def _make_part(run: DatasetRun, part: Part, render: ChunkRenderer, counts: RunCounts) -> None:
    """Make the chunks of a part under its lock; a merged data set is left alone."""
    with run.state.locked(run.identity, run.found, part=part) as state:
        if not state.is_merged:
            make_missing_chunks(run, state, part, render, counts)


def _take_left_parts(run: DatasetRun, render: ChunkRenderer) -> list[Part]:
    """Make the chunks that other machines left; return their parts, without those in work."""
    taken = []
    for part in run.state.left_parts():
        with suppress(PartBusyError):
            _make_part(run, part, render, run.counts(part))
            run.state.take_part(part)
            taken.append(part)
    return taken
