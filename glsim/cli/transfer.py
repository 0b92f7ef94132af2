"""``glsim transfer``: score networks on sensors and faces that were not in their training."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import (
    Debug,
    Quiet,
    Verbose,
    WorkersOption,
    print_message,
    print_written,
)
from glsim.errors import ConfigError, GlsimError, TrainError

if TYPE_CHECKING:
    from glsim.cli.transfers.steps import Network, Pace, Step, StudyRun
    from glsim.eval.transfer.cases import Case
    from glsim.eval.transfer.study import TransferStudy
    from glsim.train import Recipe

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
        bool, typer.Option("--small", help="A small study of some minutes, to try the command.")
    ] = False,
    study: Annotated[
        Path | None,
        typer.Option(help="Your own study, a .toml file like glsim/cli/transfers/full.toml."),
    ] = None,
    figures: Annotated[bool, typer.Option(help="Draw transfer.png.")] = True,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print the steps and their time without running them.")
    ] = False,
    workers: WorkersOption = "auto",
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Train without a sensor or a source of faces; score on what was left out, beside filters.

    Writes transfer.md, transfer.csv, transfer.json and transfer.png: interior error, normals,
    flips and flying pixels of the noisy input, the best tuned filter and the network, for each
    sensor, source of faces and scene. Test people are never in training.
    """
    from glsim.cli.transfers.steps import Pace, StudyRun
    from glsim.eval.transfer.cases import find_cases
    from glsim.worker_processes import worker_count

    if network and (train_on or steps):
        raise ConfigError("--network trains nothing: leave out --train-on and --steps")
    chosen = _load(small, study, sensor or [], ict_root)
    if steps is not None:
        chosen = chosen.model_copy(
            update={"train": chosen.train.model_copy(update={"steps": steps})}
        )
    cases = find_cases(chosen, leave or (), train_on or (), given=bool(network))
    run = StudyRun(chosen, cases, out, worker_count(workers))
    groups, networks, notes = _given(run, network) if network else _trained(run)
    todo = [step for group in groups for step in group]
    pace = Pace(run.workers)
    if plan:
        _print_plan(todo, pace)
        return
    print_message(f"{chosen.title}: {len(todo)} steps, about {_minutes(pace.seconds(todo))}")
    started, number = time.monotonic(), 0
    for group in groups:
        for step in group:
            number += 1
            _run_step(step, number, todo, pace, started)
        _write(run, networks, notes, figures=figures)  # so that long studies show what they have
    print_written(_write(run, networks, notes, figures=figures))


def _load(
    small: bool, file: Path | None, sensors: Sequence[Path], ict_root: Path | None
) -> TransferStudy:
    """Load the study, print what it leaves out. Raises ConfigError."""
    from glsim.eval.transfer.study import load_study, prepare_study

    if small and file is not None:
        raise ConfigError("give --small or --study, one of the two")
    shipped = _FOLDER / ("small.toml" if small else "full.toml")
    study, left_out = prepare_study(load_study(file or shipped), sensors, ict_root)
    for reason in left_out:
        print_message(reason)
    return study


def _given(
    run: StudyRun, specs: Sequence[str]
) -> tuple[list[list[Step]], list[Network], list[str]]:
    """Return the steps for given networks, the networks, and notes. Raises ConfigError."""
    from dataclasses import replace

    from glsim.cli.transfers.steps import Network
    from glsim.denoise import load

    named: dict[str, str] = {}
    for spec in specs:
        load(spec)  # raises its error before any work starts
        label, at, file = spec.rpartition("@")
        path = Path(file)
        name = label if at else path.parent.name if path.name == "best.pt" else path.stem
        name = re.sub(r"[^A-Za-z0-9._-]", "-", name) or "network"
        if name in (*named, "filters"):
            raise ConfigError(f"--network {spec}: name it another than {name}: LABEL@{file}")
        named[name] = file
    networks = [
        Network(name, file, replace(case, title="-"))
        for name, file in named.items()
        for case in run.cases
    ]
    groups = [list(run.test_steps()), *(list(run.network_steps(item)) for item in networks)]
    notes = [f"`{name}` is the network `{Path(file).name}`, given" for name, file in named.items()]
    return groups, networks, notes


def _trained(run: StudyRun) -> tuple[list[list[Step]], list[Network], list[str]]:
    """Return the steps with a training for each training set, the networks, and notes.

    Raises ConfigError for a wrong recipe, TrainError without PyTorch.
    """
    from glsim.cli.transfers.steps import Network

    recipe = _recipe(run.study)
    groups, networks, notes = [list(run.test_steps())], [], []
    seen: set[str] = set()
    for case in run.cases:
        training = case.training
        assert training is not None  # find_cases was asked for trainings
        name = training.name
        item = Network(name, str(run.checkpoint(training)), case)
        networks.append(item)
        group = [] if name in seen else list(run.training_steps(training, recipe))
        seen.add(name)
        groups.append([*group, *run.network_steps(item)])
        notes.append(_training_note(case, recipe))
    return _once(groups), networks, list(dict.fromkeys(notes))


def _once(groups: list[list[Step]]) -> list[list[Step]]:
    """Return the groups with each step only where it comes first."""
    seen: set[tuple[str, str]] = set()
    result = []
    for group in groups:
        fresh = [step for step in group if (step.kind, step.title) not in seen]
        seen |= {(step.kind, step.title) for step in fresh}
        result.append(fresh)
    return result


def _recipe(study: TransferStudy) -> Recipe:
    try:
        import glsim.train.loop  # noqa: F401 (is there PyTorch?)
    except ImportError as error:
        raise TrainError(
            f"training needs PyTorch and Lightning Fabric: pip install 'glsim[train]' ({error})"
        ) from None
    from glsim.train import load_recipe

    train = study.train
    limits = {"training": {"max_steps": train.steps}, "data": {"crop": train.crop}}
    return load_recipe(train.recipe, train.set, limits)


def _training_note(case: Case, recipe: Recipe) -> str:
    assert case.training is not None
    sensors = ", ".join(sensor.name for sensor in case.training.sensors)
    faces = ", ".join(source.name for source in case.training.sources)
    return (
        f"`{case.training.name}`: {recipe.title}, {recipe.training.max_steps} steps on sensors "
        f"{sensors}; faces {faces}"
    )


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


def _write(
    run: StudyRun, networks: Sequence[Network], notes: Sequence[str], *, figures: bool
) -> list[Path]:
    """Write the results that are there; return their paths, none if nothing is scored yet."""
    from glsim.eval.transfer.report import write_results

    results = run.results(networks)
    return write_results(run.study, results, notes, run.out, figure=figures) if results else []


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
