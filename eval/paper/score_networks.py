"""Scoring of denoisers and trained networks, with the paper's tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from glsim.core.errors import ConfigError, DatasetError, DenoiserError
from glsim.data.disk_format import HEADER
from glsim.data.reader import open_dataset
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.paper.paper_tables import PAPER_ROWS, paper_table
from glsim.eval.paper.trained_networks import data_note, find_trained_runs, group_by_network
from glsim.eval.report.results import write_results
from glsim.eval.report.score_tables import worse_inside
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import ScoringProgress, evaluate


def score_tables(
    job: ScoringJob,
    out: Path,
    tables: Sequence[int] = (),
    runs: Path | None = None,
    *,
    figures: bool = True,
    workers: int = 1,
    progress: Callable[[ScoringProgress], None] | None = None,
) -> tuple[list[Path], list[str]]:
    """Score the denoisers of a job and the trained networks of a folder; write all results.

    Args:
        job: what is scored; the paper's filters are added for a table, the noisy input always.
        out: folder of the results.
        tables: numbers of the paper's tables to write as paper_table_N.md.
        runs: folder with a folder per run of ``glsim train``.
        figures: draw report.html.
        workers: number of processes.
        progress: called after each block of frames.

    Returns:
        The written files, and a line for each method that harms surfaces.

    Raises:
        ConfigError: an unknown table, tables 2 and 3 without ``runs``, or a wrong denoiser.
        DatasetError: some frames could not be scored; the results of the others are written.
        DenoiserError: a checkpoint in ``runs`` was skipped; likewise.
    """
    for number in tables:
        if number not in PAPER_ROWS:
            raise ConfigError(f"--table {number}: there are 1 (filters), 2 and 3 (networks)")
        if number != 1 and runs is None:
            raise ConfigError(f"--table {number}: give --runs, the folder of trained networks")
    trained, refused = ([], []) if runs is None else find_trained_runs(runs)
    rows = {row for number in tables for row in PAPER_ROWS[number]}
    trained = [run for run in trained if not rows or run.row is None or run.row in rows]
    specs = [*PAPER_FILTERS] if tables or not job.denoisers else ["noisy"]
    specs += [*job.denoisers, *(run.spec for run in trained)]
    job = replace(job, denoisers=tuple(dict.fromkeys(specs)))
    evaluation = evaluate(job, out, workers=workers, progress=progress)
    table = evaluation.summary.table()
    pages = {f"paper_table_{n}": paper_table(n, evaluation, table, trained, refused)
             for n in tables}  # fmt: skip
    if pages and (job.dataset / HEADER).is_file():
        note = data_note(open_dataset(job.dataset))
        for page in pages.values():
            page.parts.insert(1, note)
    # The figures show one seed of each network.
    others = {run.spec for group in group_by_network(trained) for run in group.members[1:]}
    drawn = [spec for spec in job.denoisers if spec not in others]
    written = write_results(evaluation, table, job, out, pages, drawn=drawn if figures else None)
    if evaluation.bad:
        raise DatasetError(
            f"{evaluation.bad} of {evaluation.frames} frames could not be scored, see "
            f"{out / 'bad.csv'}, the first: {evaluation.first_bad[0]}; tables contain the others"
        )
    if refused:
        raise DenoiserError(
            f"{len(refused)} of the checkpoints in {runs} were skipped, the first: {refused[0]}"
        )
    harms = worse_inside({name: table[name] for name in evaluation.summary.one_composite().methods})
    return written, [
        f"{name} is worse inside than its input: {ours:.3g} against {before:.3g} mm"
        for name, (ours, before) in harms.items()
    ]
