"""``glsim paper tables``: tables 1 to 3 beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import WorkersOption
from glsim.cli.eval import (
    BaselinesOption,
    DatasetArgument,
    DenoisersOption,
    FiguresOption,
    OutOption,
    ProtocolOption,
    RunsOption,
    SplitOption,
    TruthOption,
    TuneFiltersOption,
    score_denoisers,
)

EXAMPLES = """
[bold]Examples[/bold]

glsim paper tables data -o table1                     table 1, the filters

glsim paper tables data --table 2 --table 3 --runs runs -o tables    networks in runs/*/

Repeat the same command to resume an interrupted run.
"""


def tables(
    dataset: DatasetArgument,
    table: Annotated[
        list[int],
        typer.Option(help="Table of the paper: 1 (filters), 2 or 3 (networks). Repeatable."),
    ] = [1],  # noqa: B006  # Typer reads it and makes a new list
    runs: RunsOption = None,
    denoiser: DenoisersOption = None,
    split: SplitOption = "test",
    out: OutOption = Path("scores"),
    truth: TruthOption = "clean",
    protocol: ProtocolOption = None,
    tune_filters: TuneFiltersOption = False,
    baselines: BaselinesOption = True,
    figures: FiguresOption = True,
    workers: WorkersOption = "auto",
) -> None:
    """Write the paper's tables beside ours, and all that ``glsim eval`` writes.

    Nothing is trained: tables 2 and 3 contain the networks in --runs and list the rows that are
    missing there.
    """
    score_denoisers(
        dataset, denoiser or [], out, split=split, truth=truth, protocol=protocol, runs=runs,
        tune_filters=tune_filters, baselines=baselines, figures=figures, workers=workers,
        tables=sorted(set(table)),
    )  # fmt: skip
