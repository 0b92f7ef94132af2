"""``glsim train``: train a denoiser from a recipe."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glsim.cli.common import RECIPES, console, options, overrides, print_message
from glsim.core.errors import ConfigError, counted, require_package

if TYPE_CHECKING:
    from glsim.train.loop import StepStatus

#: Seconds between the first lines of a log; they grow to 10 minutes in an hour. Chosen.
_LINE_S = 10.0
#: Metrics of a validation that are printed, by their names in metrics.csv.
_METRICS = (
    "loss {loss:.4g}, interior {interior_rmse_mm:.2f} mm (input {input_interior_rmse_mm:.2f}), "
    "flips {flips:.0f} (input {input_flips:.0f}), mse {mse_mm2:.0f} mm2"
)


def train(
    recipe: Annotated[str | None, typer.Argument(metavar="RECIPE", autocompletion=RECIPES)] = None,
    data: Annotated[list[Path] | None, typer.Option("--data", metavar="DIR")] = None,
    simulate: Annotated[bool, typer.Option("--simulate")] = False,
    minutes: float | None = None,
    steps: int | None = None,
    start: Annotated[Path | None, typer.Option("--from", metavar="BEST.PT")] = None,
    assignment: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE")] = None,
    resume: Annotated[bool, typer.Option("--resume")] = False,
    out: Annotated[Path | None, typer.Option("-o", "--out")] = None,
    protocol: str | None = None,
    seed: int | None = None,
    list_recipes: Annotated[bool, typer.Option("--list")] = False,
) -> None:
    """Train a denoiser; write checkpoints, metrics.csv, TensorBoard events and sample images.

    Args:
        recipe: A shipped recipe, or a .toml file. With --resume and -o: by default the folder's.
        data: A data set of glsim generate: a folder, or a URL such as s3://bucket/faces.
            Repeatable; data sets are joined.
        simulate: Render pairs during training instead of reading a data set.
        minutes: Training time, minutes, with resumed earlier runs. Default: the recipe's.
        steps: Number of steps. Default: the recipe's.
        start: Start from the weights of a checkpoint, an ONNX file or a shipped network (face);
            weights of further inputs start at 0. Default: random weights.
        assignment: Override the recipe, such as optimiser.lr=1e-3. Repeatable.
        resume: Continue the training in the folder, if there is one, with all --set and options of
            its recipe that it was begun with.
        out: Folder of the run. Default: runs/RECIPE.
        list_recipes: Print the shipped recipes and exit.
    """
    from glsim.core.depth_protocol import check_protocol
    from glsim.data.header import read_header
    from glsim.settings.toml_tables import flattened, toml_value
    from glsim.train.recipe import RECIPE_FILE, assignments_of, load_recipe

    if list_recipes:
        _print_list()
        return
    if recipe is None and resume and out is not None and (out / RECIPE_FILE).is_file():
        recipe = str(out / RECIPE_FILE)
    if recipe is None:
        raise ConfigError("give a recipe: a name of glsim train --list, or a .toml file")
    if bool(data) == simulate:
        raise ConfigError("give --data DIR or --simulate, one of the two")
    over = overrides(
        seed=seed, training__max_minutes=minutes, training__max_steps=steps,
        training__start=start and str(start), data__protocol=check_protocol(protocol),
    )  # fmt: skip
    folder = out if out is not None else Path("runs") / Path(recipe).stem
    given = [*(assignment or ()), *(f"{n}={toml_value(v)}" for n, v in flattened(over).items())]
    named = {text.partition("=")[0].strip() for text in given}
    begun = [text for text in assignments_of(folder) if text.partition("=")[0].strip() not in named]
    begun = begun if resume else []
    chosen = load_recipe(recipe, [*begun, *given])
    if begun:
        print_message(f"{folder}: goes on with {', '.join(begun)}")
    for each in data or ():
        read_header(each)
    for package in ("torch", "lightning_fabric"):
        require_package(package, "glsim train", "train")
    print_message(f"{chosen.title}: trains in {folder}; loading PyTorch and the data")

    from glsim.train import batches
    from glsim.train.loop import fit

    pairs = batches.stored_batches(data, chosen) if data else batches.simulated_batches(chosen)
    with stopping() as stop, training_progress(chosen.title) as show:
        report = fit(
            chosen, pairs, folder, resume=resume, on_step=show, should_stop=stop,
            announce=print_message,
        )  # fmt: skip
    _print_result(report, folder)
    if report["state"] == "interrupted":
        raise typer.Exit(1)


@contextmanager
def stopping() -> Iterator[Callable[[], bool]]:
    """Yield a function that tells if Ctrl-C or SIGTERM came; a second signal interrupts at once."""
    signals: list[int] = []

    def record(number: int, _frame: FrameType | None) -> None:
        if signals:
            raise KeyboardInterrupt
        signals.append(number)

    before = {kind: signal.signal(kind, record) for kind in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(signals)
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


@contextmanager
def training_progress(title: str) -> Iterator[Callable[[StepStatus], None] | None]:
    """Show a bar and a line per validation, or only lines without a terminal; None if --quiet."""
    if options.quiet:
        yield None
        return
    from rich import progress

    columns = (
        progress.TextColumn("{task.description}"), progress.BarColumn(20),
        progress.TextColumn("{task.fields[text]}"), progress.TimeElapsedColumn(),
    )  # fmt: skip
    with progress.Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as shown:
        task = shown.add_task(title, total=None, text="", visible=False)
        next_line_s = 0.0

        def update(now: StepStatus) -> None:
            nonlocal next_line_s
            of = f"/{now.total_steps}" if now.total_steps else ""
            place = f"step {now.steps}{of}, epoch {now.epoch}"
            minutes = f"{now.seconds / 60:.1f} min"
            if now.validation is not None:
                metrics = _METRICS.format(**now.validation)
                print_message(f"{place}, {minutes}: validation {metrics}")
            elif not console.is_terminal and now.seconds >= next_line_s:
                print_message(f"{place}, {minutes}: loss {now.loss:.3g}")
                next_line_s = now.seconds + _LINE_S * (1 + now.seconds / 60)
            total, text = 1.0 if now.fraction_done else None, f"{place}, loss {now.loss:.3g}"
            shown.update(task, total=total, completed=now.fraction_done, text=text, visible=True)

        yield update


def _print_result(report: dict[str, Any], folder: Path) -> None:
    from glsim.eval.report.score_tables import worse_inside

    best = report["best"]
    if report["state"] == "finished":
        print_message(
            f"finished ({report['ended']}) after {counted(report['steps'], 'step')}, "
            f"{report['seconds'] / 60:.1f} min: best {best['monitor']} {best['value']:.4g} at step "
            f"{best['step']}, {folder / 'best.pt'}"
        )
    else:
        later = "" if best["step"] else "; best.pt comes with the first validation"
        print_message(
            f"stopped after step {report['steps']}: saved in {folder}, go on by the same "
            f"--data, -o and --resume{later}"
        )

    figures = report["validation"]
    errors_mm = (figures.get(f"{of}interior_rmse_mm", 0.0) for of in ("", "input_"))
    if line := worse_inside(*errors_mm):
        print_message(f"{line} (last validation)")


def _print_list() -> None:
    from glsim.train.recipe import load_recipe, recipe_names

    for name in recipe_names():
        recipe = load_recipe(name)
        typer.echo(f"{name}: {recipe.title}")
        if recipe.description:
            typer.echo(f"    {recipe.description}")
