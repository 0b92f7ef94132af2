"""The ``glsim`` command line. Each sub-command has its own file and imports packages when run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from glsim.cli import (
    compare,
    corrupt,
    denoise,
    eval_real,
    export,
    fetch,
    fit,
    generate,
    import_,
    info,
    inspect,
    paper,
    preview,
    render,
    sensors,
    stages,
    train,
    transfer,
    tune,
    validate,
    verify,
)
from glsim.cli import eval as evaluate
from glsim.cli.common import run_command_line, with_messages
from glsim.cli.narrow_help import Command, Group

app = typer.Typer(
    name="glsim",
    help="3D faces in, paired clean and noisy 16-bit depth frames out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

#: Heading in the help -> name, function and examples of each command.
_GROUPS: dict[str, tuple[tuple[str, Callable[..., int | None], str], ...]] = {
    "Make data": (
        ("generate", generate.generate, generate.EXAMPLES),
        ("render", render.render, render.EXAMPLES),
        ("corrupt", corrupt.corrupt, corrupt.EXAMPLES),
        ("verify", verify.verify, verify.EXAMPLES),
        ("preview", preview.preview, preview.EXAMPLES),
        ("inspect", inspect.inspect, inspect.EXAMPLES),
        ("export", export.export, export.EXAMPLES),
        ("fetch", fetch.fetch, fetch.EXAMPLES),
    ),
    "Sensors": (
        ("sensors", sensors.sensors, sensors.EXAMPLES),
        ("stages", stages.stages, stages.EXAMPLES),
        ("validate", validate.validate, validate.EXAMPLES),
        ("compare", compare.compare, compare.EXAMPLES),
        ("fit", fit.fit, fit.EXAMPLES),
        ("tune", tune.tune, tune.EXAMPLES),
        ("info", info.info, info.EXAMPLES),
    ),
    "Denoise": (
        ("denoise", denoise.denoise, denoise.EXAMPLES),
        ("train", train.train, train.EXAMPLES),
        ("eval", evaluate.evaluate, evaluate.EXAMPLES),
        ("eval-real", eval_real.evaluate_real, eval_real.EXAMPLES),
        ("transfer", transfer.transfer, transfer.EXAMPLES),
    ),
}
for _heading, _commands in _GROUPS.items():
    for _name, _function, _examples in _commands:
        app.command(_name, epilog=_examples, rich_help_panel=_heading)(with_messages(_function))
    if _heading == "Make data":
        app.add_typer(import_.app, name="import", rich_help_panel=_heading)
app.add_typer(paper.app, name="paper", rich_help_panel="Paper")
for _group in (app, import_.app, paper.app):
    _group.info.cls = Group
    for _info in _group.registered_commands:
        _info.cls = Command


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"glsim {version('glsim')}")
        raise typer.Exit


@app.callback()
def _glsim(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """3D faces in, paired clean and noisy 16-bit depth frames out."""


def main(arguments: list[str] | None = None) -> int:
    """Run a command line (default: that of the process); returns the exit status 0, 1 or 2."""
    return run_command_line(app, arguments)
