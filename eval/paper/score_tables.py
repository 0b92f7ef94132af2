"""Score a data set and write tables with the paper's printed values beside ours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from glsim.core.errors import ConfigError
from glsim.data.progress import FrameProgress
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.paper.data_note import run_note
from glsim.eval.paper.paper_tables import PAPER_ROWS, paper_table
from glsim.eval.report.document import Document
from glsim.eval.report.score_denoisers import score_denoisers
from glsim.eval.report.score_tables import ResultTable
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import Evaluation
from glsim.eval.scoring.trained_networks import find_trained_runs


def score_tables(
    job: ScoringJob,
    out: Path,
    tables: Sequence[int],
    runs: Path | None = None,
    *,
    size: str = "",
    figures: bool = True,
    workers: int = 1,
    progress: Callable[[FrameProgress], None] | None = None,
) -> tuple[list[Path], list[str]]:
    """Score the paper's filters, denoisers and trained networks; write the paper's tables as well.

    Returns the written files, and a line for each method that harms surfaces. Raises ConfigError
    for an unknown table, or tables 2 and 3 without ``runs``, and the errors of ``score_denoisers``.

    Args:
        tables: numbers of the paper's tables to write as paper_table_N.md.
        size: end of the tables' titles, which names the plan.
    """
    for number in tables:
        if number not in PAPER_ROWS:
            raise ConfigError(f"--table {number}: there are 1 (filters), 2 to 4 (networks)")
        if number != 1 and runs is None:
            raise ConfigError(f"--table {number}: give --runs, the folder of trained networks")
    rows = {None, *(row for number in tables for row in PAPER_ROWS[number])}
    trained = None if runs is None else find_trained_runs(runs)
    if trained is not None:
        trained = trained._replace(runs=[run for run in trained.runs if run.row in rows])

    def pages(evaluation: Evaluation, table: ResultTable) -> dict[str, Document]:
        networks, refused = ([], []) if trained is None else trained[1:]
        note = run_note(job.dataset, networks)
        return {
            f"paper_table_{n}": paper_table(n, evaluation, table, networks, refused, size, note)
            for n in tables
        }

    return score_denoisers(
        replace(job, denoisers=(*PAPER_FILTERS, *job.denoisers)), out, trained, pages=pages,
        figures=figures, workers=workers, progress=progress,
    )  # fmt: skip
