"""Score denoisers and trained networks, and write all tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from glsim.core.errors import DatasetError, DenoiserError, counted
from glsim.data.progress import FrameProgress
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.report.document import Document
from glsim.eval.report.results import write_results
from glsim.eval.report.score_tables import ResultTable, result_lines
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import Evaluation, evaluate
from glsim.eval.scoring.trained_networks import TrainedNetworks, group_by_network


def score_denoisers(
    job: ScoringJob, out: Path, trained: TrainedNetworks | None = None, *,
    pages: Callable[[Evaluation, ResultTable], Mapping[str, Document]] | None = None,
    figures: bool = True, workers: int = 1, progress: Callable[[FrameProgress], None] | None = None,
) -> tuple[list[Path], list[str]]:  # fmt: skip
    """Score the denoisers of a job and trained networks; write all results.

    Args:
        job: its default denoisers are the paper's filters; the noisy input is always scored.
        trained: networks of ``glsim train``, scored beside the denoisers.
        pages: function that makes further pages from the scores: file name without .md -> page.

    Returns:
        The written files, and lines: the best methods, and each method that harms surfaces.

    Raises:
        ConfigError: a wrong denoiser.
        DatasetError: some frames could not be scored; the results of the others are written.
        DenoiserError: a checkpoint of ``trained`` was skipped; the other results are written.
    """
    runs = [] if trained is None else trained.runs
    given = (*job.denoisers, *job.tuned) or PAPER_FILTERS
    specs = ["noisy", *given, *(run.spec for run in runs)]
    job = replace(job, denoisers=tuple(dict.fromkeys(specs)))
    evaluation = evaluate(job, out, workers=workers, progress=progress)
    table = evaluation.summary.table()
    more = {} if pages is None else pages(evaluation, table)
    # The figures show one seed of each network.
    others = {run.spec for group in group_by_network(runs) for run in group.members[1:]}
    drawn = [spec for spec in job.denoisers if spec not in others]
    written = write_results(evaluation, table, job, out, more, drawn=drawn if figures else None)
    if evaluation.bad:
        raise DatasetError(
            f"{evaluation.bad} of {counted(evaluation.frames, 'frame')} could not be scored by "
            f"some methods, or all, see {out / 'bad.csv'}, the first: {evaluation.first_bad[0]}; "
            "tables have the others"
        )
    if trained is not None and trained.refused:
        raise DenoiserError(
            f"{len(trained.refused)} of the checkpoints in {trained.folder} were skipped, the "
            f"first: {trained.refused[0]}"
        )
    lines = result_lines(evaluation.summary.one_composite())
    return written, [line.replace("`", "") for line in lines]
