"""``glsim paper resample``, ``experiments``: table 1 on other surfaces and with other noise."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import print_message, print_written
from glsim.cli.eval import DatasetArgument, SplitOption
from glsim.cli.paper.pages import FolderArgument
from glsim.errors import ConfigError, did_you_mean

RESAMPLE_EXAMPLES = """
[bold]Examples[/bold]

glsim paper resample data --factor 4 -o resampled

glsim paper tables resampled -o scores        table 1 on these maps
"""
EXPERIMENTS_EXAMPLES = """
[bold]Examples[/bold]

glsim paper experiments reproduced
"""


def resample(
    dataset: DatasetArgument,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the pairs of PNG files.")],
    factor: Annotated[int, typer.Option(help="How many times the maps are reduced.")] = 2,
    mask: Annotated[
        str,
        typer.Option(
            help="Clean maps: dense, or as-noisy (no depth where the noisy map has none)."
        ),
    ] = "dense",
    split: SplitOption = "test",
) -> None:
    """Write pairs whose noise is a loss of resolution: clean maps reduced and enlarged again."""
    from glsim.eval.paper.cases import MASKS
    from glsim.eval.paper.resampled import write_resampled

    if mask not in MASKS:
        raise ConfigError(f"--mask {mask}: no such mask ({did_you_mean(mask, MASKS)})")
    written = write_resampled(dataset, split, factor, mask, out)
    print_message(f"wrote {len(written) // 2} pairs to {out}")


def experiments(folder: FolderArgument) -> None:
    """Write experiments.html: table 1 on boards, with other noise, and with resampled maps."""
    from glsim.eval.paper.experiment_page import write_experiments

    print_written(write_experiments(folder))
