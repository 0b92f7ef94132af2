"""``glsim eval``: score denoisers on a data set."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from glsim.cli.common import check_outputs, print_message, print_written
from glsim.cli.progress import frame_progress
from glsim.core.errors import ConfigError, did_you_mean, pip_install

if TYPE_CHECKING:
    from glsim.eval.scoring.blocks import ScoringJob

DenoisersOption = Annotated[
    list[str] | None,
    typer.Option(
        "--denoiser",
        "-d",
        metavar="[LABEL@]NAME[:KEY=VALUE,...]",
        help="A shipped denoiser (glsim eval --list), module:function, or a checkpoint. "
        "Repeatable.",
    ),
]
OutOption = Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")]


def figures_wanted(asked: bool) -> bool:
    """Return whether to draw figures; print a message if a needed library is missing."""
    if not asked:
        return False
    missing = [name for name in ("Matplotlib", "Jinja2") if find_spec(name.lower()) is None]
    if missing:
        print_message(
            f"no figures and no report.html, tables alone: they need {' and '.join(missing)}: "
            f"{pip_install('eval')}"
        )
    return not missing


def _print_list(asked: bool) -> None:
    if not asked:
        return
    from glsim.core.plugins import each_usable
    from glsim.denoise.registry import denoiser_names, describe_denoiser

    for name, (help, parameters) in each_usable(denoiser_names(), describe_denoiser):
        typer.echo(f"{name}: {help}")
        for parameter, (default, text) in parameters.items():
            value = "" if default is None else f"={default:g}"
            typer.echo(f"    {parameter}{value}  {text}")
    raise typer.Exit


def evaluate(
    dataset: Path,
    denoiser: DenoisersOption = None,
    split: str = "test",
    out: OutOption = Path("scores"),
    truth: str = "clean",
    protocol: str | None = None,
    runs: Path | None = None,
    tune_filters: Annotated[bool, typer.Option("--tune-filters")] = False,
    figures: bool = True,
    workers: str = "auto",
    focal_px: Annotated[float | None, typer.Option(min=1)] = None,
    device: Path | None = None,
    _list_denoisers: Annotated[
        bool, typer.Option("--list", callback=_print_list, is_eager=True)
    ] = False,
) -> None:
    """Score denoisers; write rows.csv, table.md, table.csv and report.html with figures.

    The noisy input is the first row. Maps are scored unrounded, as denoisers return them. Frames
    that cannot be scored are reported and skipped; the exit status is then 1.

    Args:
        truth: What predictions are compared with: clean, or expected (clean with the sensor's
            systematic error, which a denoiser leaves).
        tune_filters: Add the classical filters, tuned on the validation split.
        _list_denoisers: Print the shipped denoisers and exit.
    """
    from glsim.core.depth_protocol import check_protocol
    from glsim.eval.report.score_denoisers import score_denoisers
    from glsim.eval.scoring.blocks import ScoringJob
    from glsim.eval.scoring.pairs import TruthLayer
    from glsim.eval.scoring.trained_networks import find_trained_runs

    if truth not in get_args(TruthLayer):
        raise ConfigError(f"--truth {truth}: {did_you_mean(truth, get_args(TruthLayer))}")
    job = ScoringJob(
        dataset, split, tuple(denoiser or ()), focal_px, truth=cast(TruthLayer, truth),
        device=device, protocol=check_protocol(protocol),
    )  # fmt: skip
    trained = None if runs is None else find_trained_runs(runs)
    score = partial(score_denoisers, trained=trained)
    tuned = _add_tuned_filters if tune_filters else None
    score_and_write(score, job, out, figures, workers, tuned)


@contextmanager
def named_losses(table: Path) -> Iterator[None]:
    """Check that a table can be written; after the block, name the methods that it lost."""

    def methods() -> list[str]:
        text = table.read_text("utf-8") if table.is_file() else ""
        return list(dict.fromkeys(re.findall(r"^\| `(.+?)` \|", text, re.MULTILINE)))

    check_outputs(table)
    before = methods()
    try:
        yield
    finally:
        after = methods()
        if lost := [name for name in before if name not in after]:
            print_message(f"{table}: replaced one with {', '.join(lost)}: next time give -o NEW")


def score_and_write(
    score: Callable[..., tuple[list[Path], list[str]]], job: ScoringJob, out: Path, figures: bool,
    workers: str, tune: Callable[[ScoringJob, Path, int], ScoringJob] | None = None,
) -> None:  # fmt: skip
    """Score with a progress bar, and print the names of the written files.

    ``score`` has the parameters of ``score_denoisers``. ``tune`` adds denoisers to the job.
    """
    from glsim.data.worker_processes import worker_count

    count = worker_count(workers)
    figures = figures_wanted(figures)
    with named_losses(out / "table.md"):
        if tune is not None:
            job = tune(job, out, count)
        with frame_progress("scoring") as progress:
            written, harms = score(job, out, figures=figures, workers=count, progress=progress)
        if not job.tuned:  # that of an earlier table
            (out / "tuning.csv").unlink(missing_ok=True)
    print_written(written)
    for line in filter(None, (job.frames().note, *harms)):
        print_message(line)


def _add_tuned_filters(job: ScoringJob, out: Path, count: int) -> ScoringJob:
    from glsim.denoise.registry import GRIDS
    from glsim.eval.scoring.grid_search import tune_filters

    if job.split == "val":
        raise ConfigError("--tune-filters: settings tuned on val must be scored on another split")
    held_out = replace(job, split="val")
    frames = held_out.frames()
    if not len(frames) or frames.identity == job.frames().identity:
        raise ConfigError(
            f"--tune-filters: {job.dataset} has no frames in val, where settings are tuned: use a "
            "data set of glsim generate --set split=0.7,0.1,0.2"
        )
    with frame_progress("tuning") as progress:
        tuned = tune_filters(held_out, list(GRIDS), out, workers=count, progress=progress)
    for item in tuned:
        print_message(f"tuned {item.plain} and {item.cleaned.split(',')[-1]}")
    return replace(job, tuned=tuple(s for item in tuned for s in (item.plain, item.cleaned)))
