"""``glsim transfer``: score networks on sensors and faces that were not in their training."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import (
    MORE,
    WorkersOption,
    print_message,
    print_written,
)
from glsim.cli.figures import figures_wanted
from glsim.errors import ConfigError, GlsimError

if TYPE_CHECKING:
    from glsim.cli.transfers.steps import Pace, Step
    from glsim.eval.transfer.study import TransferStudy

EXAMPLES = """
[bold]Examples[/bold]

glsim transfer -o transfer --network face             the shipped network, under every sensor

glsim transfer -o transfer --train-on any --ict-root FaceXModel     one training, on random sensors

glsim transfer -o transfer --leave sensor:led3d --leave source:heads --steps 3000

glsim transfer -o transfer --leave all --plan         print the steps without running them

glsim transfer -o mine --network run/best.pt --sensor my_camera.toml

glsim transfer -o mine --study my_study.toml

Repeat the same command to resume an interrupted one.
"""

_FOLDER = Path(__file__).parent / "transfers"


def transfer(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for all data and results.")],
    leave: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave out sensor:NAME, source:NAME (of faces), or all of them, one after the "
            "other; with --network, the only cells to score. Repeatable.",
        ),
    ] = None,
    train_on: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SENSOR",
            help="Train on this sensor alone, such as any: one training leaves out every other "
            "sensor. Repeatable.",
        ),
    ] = None,
    network: Annotated[
        list[str] | None,
        typer.Option(
            "--network",
            "-d",
            metavar="[LABEL@]FILE",
            help="Score this network (best.pt, .onnx, or face) and train none. Repeatable.",
        ),
    ] = None,
    sensor: Annotated[
        list[Path] | None,
        typer.Option(help="Also test under the sensor of this .toml file. Repeatable."),
    ] = None,
    ict_root: Annotated[
        Path | None,
        typer.Option(help="ICT-FaceKit's FaceXModel. Without it: no such faces."),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of each training. Default: as in the study.")
    ] = None,
    small: Annotated[
        bool,
        typer.Option(
            "--small",
            help="A small study of some minutes, to try the command.",
            rich_help_panel=MORE,
        ),
    ] = False,
    study: Annotated[
        Path | None,
        typer.Option(
            help="Your own study, a .toml file like glsim/cli/transfers/full.toml.",
            rich_help_panel=MORE,
        ),
    ] = None,
    composite: Annotated[
        str,
        typer.Option(
            help="Use of a network's probability of depth, as for glsim denoise.",
            rich_help_panel=MORE,
        ),
    ] = "measured",
    figures: Annotated[bool, typer.Option(help="Draw transfer.png.", rich_help_panel=MORE)] = True,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print the steps and their time without running them.")
    ] = False,
    workers: WorkersOption = "auto",
) -> None:
    """Train without a sensor or a source of faces; score on the one left out, beside filters.

    Writes transfer.md, transfer.csv, transfer.json and transfer.png: interior error, normals,
    flips and flying pixels of the noisy input, the best tuned filter and the network, for each
    sensor, source of faces and scene. Test people are never in training.
    """
    from glsim.cli.transfers.networks import steps_of_given, steps_of_trainings
    from glsim.cli.transfers.steps import Pace, StudyRun
    from glsim.denoise import COMPOSITES
    from glsim.eval.transfer.cases import find_cases
    from glsim.eval.transfer.report import write_results
    from glsim.worker_processes import worker_count

    if composite not in COMPOSITES:
        raise ConfigError(f"--composite {composite}: choose one of {', '.join(COMPOSITES)}")
    if network and (train_on or steps):
        raise ConfigError("--network trains nothing: leave out --train-on and --steps")
    chosen = _load(small, study, sensor or [], ict_root)
    if steps is not None:
        chosen = chosen.model_copy(
            update={"train": chosen.train.model_copy(update={"steps": steps})}
        )
    cases = find_cases(chosen, leave or (), train_on or (), given=bool(network))
    run = StudyRun(chosen, cases, out, worker_count(workers))
    if network:
        work = steps_of_given(run, network, composite)
    else:
        work = steps_of_trainings(run, composite)
    work.notes.append(f"A soft validity becomes a map by the composite `{composite}`")
    todo = [step for group in work.groups for step in group]
    figures = figures_wanted(figures)
    pace = Pace(run.workers)
    if plan:
        _print_plan(todo, pace)
        return
    print_message(f"{chosen.title}: {len(todo)} steps, about {_minutes(pace.seconds(todo))}")
    started, number = time.monotonic(), 0
    written: list[Path] = []
    for group in work.groups:
        for step in group:
            number += 1
            _run_step(step, number, todo, pace, started)
        if results := run.results(work.networks):  # so that a long study shows what it has
            written = write_results(chosen, results, work.notes, out, figure=figures)
    print_written(written)


def _load(
    small: bool, file: Path | None, sensors: Sequence[Path], ict_root: Path | None
) -> TransferStudy:
    """Load the study, print what it leaves out. Raises ConfigError."""
    from glsim.eval.transfer.load import load_study, prepare_study

    if small and file is not None:
        raise ConfigError("give --small or --study, one of the two")
    shipped = _FOLDER / ("small.toml" if small else "full.toml")
    study, left_out = prepare_study(load_study(file or shipped), sensors, ict_root)
    for reason in left_out:
        print_message(reason)
    return study


def _run_step(step: Step, number: int, todo: Sequence[Step], pace: Pace, started: float) -> None:
    """Run a step and note its pace. Raises its error, with the place."""
    elapsed, left = time.monotonic() - started, pace.seconds(todo[number - 1 :])
    state = ", was complete" if step.complete() else ""
    print_message(
        f"{number}/{len(todo)}, {_minutes(elapsed)}, about {_minutes(left)} left{state}: "
        f"{step.title}"
    )
    begun = time.monotonic()
    try:
        units = step.run()
    except GlsimError as error:
        raise type(error)(
            f"step {number} of {len(todo)} ({step.title}): {error}: the same command goes on there"
        ) from error
    pace.note(step.kind, units, time.monotonic() - begun)


def _print_plan(todo: Sequence[Step], pace: Pace) -> None:
    for number, step in enumerate(todo, 1):
        state = "complete" if step.complete() else f"about {_minutes(pace.seconds([step]))}"
        typer.echo(f"{number}/{len(todo)}: {step.title} ({state})")
    typer.echo(f"about {_minutes(pace.seconds(todo))} in all; nothing was written")


def _minutes(seconds: float) -> str:
    """Return a time as text."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
