"""``glsim paper``: reproduce the paper."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from glsim.cli import eval as cli_eval
from glsim.cli.common import (
    PlainCommand,
    epilog,
    make_console,
    print_message,
    print_written,
    with_messages,
)
from glsim.cli.progress import frame_progress
from glsim.core.errors import ConfigError, require_package

app = typer.Typer(
    help="Reproduce the paper: its data, networks, tables and figures.",
    epilog=epilog("paper"),
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
)

RootOption = Annotated[
    Path | None, typer.Option(help="Folder of this face set of the paper. Default: embedded heads.")
]
FolderArgument = Annotated[Path, typer.Argument(help="Folder of glsim paper reproduce.")]


def reproduce(
    out: Annotated[Path, typer.Option("-o", "--out")],
    size: str = "small",
    plan: Annotated[bool, typer.Option("--plan")] = False,
    d3dfacs: RootOption = None,
    facewarehouse: RootOption = None,
    biwi: RootOption = None,
    workers: str = "auto",
) -> None:
    """Reproduce the paper: generate data, train networks, write tables 1 to 3 with our values.

    One folder contains all results: data/, runs/, paper_table_1.md to _4.md, paper_values.html,
    each printed value beside ours, and, but for tiny, report.html and paper_figures/.
    protocol_paper/ holds the networks and tables under the paper's protocol (nearest point at
    1 mm), mask_as-noisy/ those with BlenSor's mask. A finished step is not repeated: delete its
    folder to do it again.

    Args:
        out: Folder for all results.
        size: Plan: tiny (a check), quick or small (CPU), full (GPU), or your own .toml.
        plan: Print the steps and their hours without running them.
    """
    from glsim.cli.train import stopping, training_progress
    from glsim.data.worker_processes import worker_count
    from glsim.eval.paper.reproduce import load_plan
    from glsim.eval.paper.reproduce import reproduce as run
    from glsim.eval.paper.runner import Displays, Runner

    for package in ("torch", "lightning_fabric", "matplotlib", "jinja2"):  # not after hours of data
        require_package(package, "paper reproduce", "laptop")
    chosen = load_plan(size)
    given = {"d3dfacs": d3dfacs, "facewarehouse": facewarehouse, "biwi": biwi}
    roots = {kind: root for kind, root in given.items() if root is not None}
    steps: list[str] = []
    announce = steps.append if plan else print_message
    displays = Displays(frame_progress, training_progress, stopping)
    runner = Runner(out, worker_count(workers), announce, displays, dry=plan)
    print_message(chosen.title)
    print_written(run(chosen, runner, roots))
    groups: dict[str, list[str]] = {}
    for step in steps:
        kind, cut, name = step.rpartition("/") if step.startswith("train") else step.partition(" ")
        groups.setdefault(kind + cut.strip(), []).append(name)
    for kind, names in groups.items():
        make_console().print(f"{kind} ({len(names)}): {', '.join(names)}")
    if plan:
        typer.echo(chosen.hours().markdown())


def tables(
    dataset: Path,
    table: list[int] = [1],  # noqa: B006  # Typer reads it and makes a new list
    runs: Path | None = None,
    denoiser: cli_eval.DenoisersOption = None,
    split: str = "test",
    out: cli_eval.OutOption = Path("scores"),
    protocol: str | None = None,
    figures: bool = True,
    workers: str = "auto",
) -> None:
    """Write the paper's tables with our values added, and all files of glsim eval.

    Nothing is trained: tables 2 and 3 contain the networks in --runs and list missing rows.

    Args:
        table: Table of the paper: 1 (filters), 2, 3 (networks), 4 (published rivals). Repeatable.
    """
    from glsim.core.depth_protocol import check_protocol
    from glsim.eval.paper.score_tables import score_tables
    from glsim.eval.scoring.blocks import ScoringJob

    job = ScoringJob(dataset, split, tuple(denoiser or ()), protocol=check_protocol(protocol))
    score = partial(score_tables, tables=sorted(set(table)), runs=runs)
    cli_eval.score_and_write(score, job, out, figures, workers)


def figures(folder: FolderArgument) -> None:
    """Draw the paper's figures 1 to 6 from the data and networks of a reproduction."""
    from glsim.eval.paper.figures.draw_figures import write_paper_figures

    print_written(write_paper_figures(folder, lambda name: print_message(f"drawing {name}")))


def values(folder: FolderArgument) -> None:
    """Write paper_values.html, which judges each printed value beside ours."""
    from glsim.eval.paper.ours_beside_printed import write_values

    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder: run glsim paper reproduce -o {folder} first")
    print_written(write_values(folder))


for _name, _command, _short in (
    ("reproduce", reproduce, "Data, networks, tables and figures."),
    ("tables", tables, "Tables 1 to 3, printed and ours."),
    ("figures", figures, "Figures 1 to 6 of a reproduction."),
    ("values", values, "Each printed value beside ours."),
):
    app.command(_name, cls=PlainCommand, short_help=_short, epilog=epilog(f"paper {_name}"))(
        with_messages(_command)
    )
