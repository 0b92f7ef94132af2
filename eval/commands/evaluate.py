"""``glsim eval``: score denoisers on a data set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from glsim.cli.common import Debug, Quiet, Verbose, console, listed, say
from glsim.errors import ConfigError, DatasetError, DenoiserError

from .common import DenoiserOption, FocalOption, WorkersOption, bar, processes

if TYPE_CHECKING:
    from ..blocks import Scoring
    from ..run import Evaluation
    from ..trained import Trained

EXAMPLES = """
[bold]Examples[/bold]

glsim eval data -d median -d quadric:sigma_px=2.5,cleanup=5 -o scores

glsim eval data --paper-table 1 -o table1

glsim eval data --paper-table 2 --paper-table 3 --runs runs -o tables    checkpoints in runs/*/

glsim eval data --tune -o scores         every classical filter, tuned on the validation split

glsim eval data -d noisy -d mine@my_module:my_function -d run/best.pt

glsim eval folder_of_pairs -d median     *_clean.png and *_noisy.png of any origin

glsim eval --list

The same command again resumes an interrupted run.
"""


def evaluate(
    dataset: Annotated[
        Path | None, typer.Argument(help="A data set, or a folder of *_clean.png and *_noisy.png.")
    ] = None,
    denoiser: DenoiserOption = None,
    split: Annotated[str, typer.Option(help="train, val or test.")] = "test",
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for results.")] = Path("scores"),
    paper_table: Annotated[
        list[int] | None,
        typer.Option(
            help="The paper's values beside ours: 1 its filters, 2 and 3 its networks. Repeatable."
        ),
    ] = None,
    runs: Annotated[
        Path | None, typer.Option(help="Score the networks that glsim train left in RUNS/*/.")
    ] = None,
    tune: Annotated[
        bool,
        typer.Option("--tune", help="Add the classical filters, tuned on the validation split."),
    ] = False,
    probes: Annotated[bool, typer.Option(help="Score trivial predictions too.")] = True,
    figures: Annotated[bool, typer.Option(help="Draw figures and report.html.")] = True,
    workers: WorkersOption = "auto",
    focal_px: FocalOption = None,
    list_denoisers: Annotated[
        bool, typer.Option("--list", help="Print the shipped denoisers and leave.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Score denoisers: rows.csv, table.md, table.csv, table.tex and report.html with figures.

    Frames that cannot be scored are named, counted and left out; the exit status is then 1.
    Without --denoiser the paper's filters are scored. Nothing is trained: tables 2 and 3 are of
    the networks in --runs, and say which rows are missing there.
    """
    from ..blocks import Scoring
    from ..denoisers import PAPER
    from ..run import evaluate as run

    if list_denoisers:
        _print_list()
        return
    if dataset is None:
        raise ConfigError("give the folder of a data set")
    tables = sorted(set(paper_table or ()))
    networks = _networks(tables, runs)
    specs = list(denoiser or ())
    if tables or not specs:
        specs = [*PAPER, *(spec for spec in specs if spec not in PAPER)]
    specs += [one.spec for one in networks.trained]
    count = processes(workers)
    job = Scoring(dataset, split, tuple(specs), focal_px)
    if tune:
        job = _tuned(job, out, count)
    with bar("scoring") as progress:
        found = run(job, out, workers=count, probes=probes, progress=progress)
    _write(found, job, out, tables, networks, figures)
    for text in found.first_bad:
        console.print(f"bad {text}", style="yellow", markup=False)
    if found.bad:
        raise DatasetError(
            f"{found.bad} of {found.frames} frames could not be scored, see {out / 'bad.csv'}; "
            "the tables are of the others"
        )
    if networks.refused:
        raise DenoiserError(
            f"{len(networks.refused)} of the checkpoints in {runs} were left out, the first: "
            f"{networks.refused[0]}"
        )


class _Networks(NamedTuple):
    trained: list[Trained]
    refused: list[str]


def _networks(tables: list[int], runs: Path | None) -> _Networks:
    """Those that the tables are of; every one if they are of none."""
    from ..paper_networks import ROWS
    from ..trained import find_trained

    for table in tables:
        if table not in (1, *ROWS):
            raise ConfigError(f"--paper-table {table}: there are 1 (filters), 2 and 3 (networks)")
        if table in ROWS and runs is None:
            raise ConfigError(f"--paper-table {table}: give --runs, the folder of trained networks")
    if runs is None:
        return _Networks([], [])
    trained, refused = find_trained(runs)
    for why in refused:
        console.print(f"left out {why}", style="yellow", markup=False)
    rows = {row for table in tables for row in ROWS.get(table, ())}
    wanted = [one for one in trained if not rows or one.row is None or one.row in rows]
    return _Networks(wanted, refused)


def _tuned(job: Scoring, out: Path, count: int) -> Scoring:
    from dataclasses import replace

    from ..denoisers import GRIDS
    from ..tune import tune

    if job.split == "val":
        raise ConfigError("--tune: settings chosen on val must be scored on another split")
    held_out = replace(job, split="val")
    if held_out.frames().identity == job.frames().identity:
        raise ConfigError(f"--tune: {job.dataset} has no splits: nothing to tune on but the test")
    with bar("tuning") as progress:
        tuned = tune(held_out, list(GRIDS), out, workers=count, progress=progress)
    specs = [spec for item in tuned for spec in (item.plain, item.cleaned)]
    for item in tuned:
        say(f"tuned {item.plain} and {item.cleaned.split(',')[-1]}")
    return replace(job, denoisers=tuple(dict.fromkeys([*job.denoisers, *specs])))


def _write(
    found: Evaluation,
    job: Scoring,
    out: Path,
    tables: list[int],
    networks: _Networks,
    figures: bool,
) -> None:
    from glsim.dataset.files import write_bytes

    from ..paper import paper_table
    from ..paper_networks import network_table
    from ..tables import latex, markdown, write_table_csv
    from ..trained import grouped

    table = found.summary.compared()
    heading = f"{job.dataset.name}, {job.split}"
    pages = {
        which: paper_table(found, table)
        if which == 1
        else network_table(which, found, table, *networks)
        for which in tables
    }
    texts = {"table.md": markdown(found, table, heading), "table.tex": latex(table)}
    texts |= {f"paper_table_{which}.md": page.markdown() for which, page in pages.items()}
    for name, text in texts.items():
        write_bytes(text.encode(), out / name)
    write_table_csv(out / "table.csv", table)
    paths = [out / "rows.csv", out / "table.csv", *(out / name for name in texts)]
    if figures:
        from ..report import write_report

        # One seed of each network is enough to look at.
        others = {one.spec for group in grouped(networks.trained) for one in group.members[1:]}
        drawn = [spec for spec in job.denoisers if spec not in others]
        report = write_report(found, table, job, out, heading, list(pages.values()), drawn)
        paths.append(report)
    listed(paths)


def _print_list() -> None:
    from ..denoisers import describe, known

    for name in known():
        help, parameters = describe(name)
        typer.echo(f"{name}: {help}")
        for parameter, (default, text) in parameters.items():
            typer.echo(f"    {parameter}={default:g}  {text}")
