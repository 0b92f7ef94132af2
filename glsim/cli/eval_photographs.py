"""``glsim eval DATASET --photo-runs``: score networks of photographs on depth."""

from __future__ import annotations

from pathlib import Path

from glsim.cli.common import console, options, print_written
from glsim.eval.scoring.blocks import ScoringJob

#: Files that are written to the folder of the results.
_PAGE, _ROWS = "photographs.md", "photographs.csv"


def evaluate_photographs(
    dataset: Path, split: str, photo_runs: Path, runs: Path, out: Path
) -> None:
    """Write photographs.md and photographs.csv. Raises ConfigError, DatasetError, DenoiserError."""
    from rich import progress

    from glsim.dataset import open_dataset
    from glsim.dataset.disk_format import HEADER
    from glsim.eval.paper.data_note import data_note
    from glsim.eval.paper.photograph_table import photograph_table
    from glsim.files.atomic import write_atomic

    frames = ScoringJob(dataset, split, ()).frames()
    with progress.Progress(console=console, transient=True, disable=options.quiet) as shown:
        task = shown.add_task("scoring", total=None)
        page, rows = photograph_table(
            frames, photo_runs, runs, lambda done, total: shown.update(
                task, completed=done, total=total
            )
        )  # fmt: skip
    if (dataset / HEADER).is_file():
        page.parts.insert(1, data_note(open_dataset(dataset)))
    paths = [out / _PAGE, out / _ROWS]
    for path, text in zip(paths, (page.markdown(), rows), strict=True):
        write_atomic(text.encode(), path)
    print_written(paths)
