"""``glsim eval``: score denoisers on a data set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import Debug, Quiet, Verbose, console, listed, say
from glsim.errors import ConfigError, DatasetError

from .common import DenoiserOption, FocalOption, WorkersOption, bar, processes

if TYPE_CHECKING:
    from ..blocks import Scoring
    from ..run import Evaluation

EXAMPLES = """
[bold]Examples[/bold]

glsim eval data -d median -d quadric:sigma_px=2.5,cleanup=5 -o scores

glsim eval data --paper-table 1 -o table1

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
        int | None, typer.Option(help="1: the paper's filters, its printed values beside ours.")
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
    Without --denoiser the paper's filters are scored.
    """
    from ..blocks import Scoring
    from ..denoisers import PAPER
    from ..run import evaluate as run

    if list_denoisers:
        _print_list()
        return
    if dataset is None:
        raise ConfigError("give the folder of a data set")
    if paper_table not in (None, 1):
        raise ConfigError(f"--paper-table {paper_table}: there is 1; 2 and 3 are of networks")
    specs = list(denoiser or ())
    if paper_table or not specs:
        specs = [*PAPER, *(spec for spec in specs if spec not in PAPER)]
    count = processes(workers)
    job = Scoring(dataset, split, tuple(specs), focal_px)
    if tune:
        job = _tuned(job, out, count)
    with bar("scoring") as progress:
        found = run(job, out, workers=count, probes=probes, progress=progress)
    _write(found, job, out, bool(paper_table), figures)
    for text in found.first_bad:
        console.print(f"bad {text}", style="yellow", markup=False)
    if found.bad:
        raise DatasetError(
            f"{found.bad} of {found.frames} frames could not be scored, see {out / 'bad.csv'}; "
            "the tables are of the others"
        )


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


def _write(found: Evaluation, job: Scoring, out: Path, paper: bool, figures: bool) -> None:
    from glsim.dataset.files import write_bytes

    from ..paper import paper_table
    from ..tables import latex, markdown, write_table_csv

    table = found.summary.compared()
    heading = f"{job.dataset.name}, {job.split}"
    texts = {"table.md": markdown(found, table, heading), "table.tex": latex(table)}
    if paper:
        texts["paper_table_1.md"] = paper_table(found, table)
    for name, text in texts.items():
        write_bytes(text.encode(), out / name)
    write_table_csv(out / "table.csv", table)
    paths = [out / "rows.csv", out / "table.csv", *(out / name for name in texts)]
    if figures:
        from ..report import write_report

        paths.append(write_report(found, table, job, out, heading))
    listed(paths)


def _print_list() -> None:
    from ..denoisers import describe, known

    for name in known():
        help, parameters = describe(name)
        typer.echo(f"{name}: {help}")
        for parameter, (default, text) in parameters.items():
            typer.echo(f"    {parameter}={default:g}  {text}")
