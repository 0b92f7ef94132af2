"""The run of one part of a data set, which merges all parts if it was the last one."""

from __future__ import annotations

from glsim.data.dataset_run import (
    ChunkRenderer,
    DatasetRun,
    absent_chunks,
    finish,
    make_missing_chunks,
)
from glsim.data.parts import Part
from glsim.data.progress import PartSummary, Progress


def run_part(
    run: DatasetRun, part: Part, render: ChunkRenderer, progress: Progress | None
) -> PartSummary:
    """Make the chunks of a part with ``render``, and merge if no chunk is missing then."""
    counts = run.counts(part, progress)
    with run.state.locked(run.identity, part=part) as state:
        if not state.is_merged:
            make_missing_chunks(run, state, part, render, counts)
    counts.report(last=True)
    # The part that completes the last chunk sees all records here, after its lock is free: two
    # parts that end together both come to this line, and the second finds the work done.
    absent = absent_chunks(run.state, run.plan)
    whole = None
    if not absent:
        with run.state.locked(run.identity, wait=True) as state:
            whole = finish(state, run.plan, run.identity, run.counts())
    return PartSummary(
        part=part,
        frames=counts.frames,
        skipped=counts.skipped,
        rendered=counts.rendered,
        reused=counts.reused,
        seconds=counts.seconds,
        absent_chunks=len(absent),
        dataset=whole,
    )
