"""``glsim paper photographs``: score networks of photographs on depth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import console, options, print_written
from glsim.cli.eval import DatasetArgument, OutOption, SplitOption

EXAMPLES = """
[bold]Examples[/bold]

glsim paper photographs data --runs runs --photo-runs photo_runs -o scores
"""

#: Files that are written to the folder of the results.
_PAGE, _ROWS = "photographs.md", "photographs.csv"


def photographs(
    dataset: DatasetArgument,
    photo_runs: Annotated[
        Path, typer.Option(help="Networks that glsim train --photos wrote to PHOTO_RUNS/*/*/.")
    ],
    runs: Annotated[
        Path, typer.Option(help="Networks of the same recipes, trained on depth, in RUNS/*/.")
    ],
    split: SplitOption = "test",
    out: OutOption = Path("scores"),
) -> None:
    """Score denoisers of photographs on depth, beside those of the same recipes trained on depth.

    Writes photographs.md and photographs.csv.
    """
    from rich import progress

    from glsim.dataset import open_dataset
    from glsim.dataset.disk_format import HEADER
    from glsim.eval.paper.data_note import data_note
    from glsim.eval.paper.photograph_table import photograph_table
    from glsim.eval.scoring.blocks import ScoringJob
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
