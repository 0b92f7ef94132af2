"""The ``glsim`` command line. Each sub-command has its own file and imports packages when run."""

from __future__ import annotations

from typing import Annotated

import typer

from glsim.cli import (
    compare,
    corrupt,
    denoise,
    export,
    fit,
    generate,
    import_,
    info,
    inspect,
    preview,
    render,
    reproduce,
    sensors,
    stages,
    study,
    train,
    transfer,
    tune,
    validate,
    verify,
)
from glsim.cli import eval as evaluate
from glsim.cli.common import run_command_line, with_messages

app = typer.Typer(
    name="glsim",
    help="3D faces in, paired clean and noisy 16-bit depth frames out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("render", epilog=render.EXAMPLES)(with_messages(render.render))
app.command("generate", epilog=generate.EXAMPLES)(with_messages(generate.generate))
app.command("preview", epilog=preview.EXAMPLES)(with_messages(preview.preview))
app.command("verify", epilog=verify.EXAMPLES)(with_messages(verify.verify))
app.command("corrupt", epilog=corrupt.EXAMPLES)(with_messages(corrupt.corrupt))
app.command("validate", epilog=validate.EXAMPLES)(with_messages(validate.validate))
app.command("compare", epilog=compare.EXAMPLES)(with_messages(compare.compare))
app.command("reproduce", epilog=reproduce.EXAMPLES)(with_messages(reproduce.reproduce))
app.command("tune", epilog=tune.EXAMPLES)(with_messages(tune.tune))
app.command("fit", epilog=fit.EXAMPLES)(with_messages(fit.fit))
app.command("inspect", epilog=inspect.EXAMPLES)(with_messages(inspect.inspect))
app.add_typer(import_.app, name="import")
app.command("sensors", epilog=sensors.EXAMPLES)(with_messages(sensors.sensors))
app.command("stages", epilog=stages.EXAMPLES)(with_messages(stages.stages))
app.command("info", epilog=info.EXAMPLES)(with_messages(info.info))
app.command("train", epilog=train.EXAMPLES)(with_messages(train.train))
app.command("eval", epilog=evaluate.EXAMPLES)(with_messages(evaluate.evaluate))
app.command("denoise", epilog=denoise.EXAMPLES)(with_messages(denoise.denoise))
app.command("export", epilog=export.EXAMPLES)(with_messages(export.export))
app.command("study", epilog=study.EXAMPLES)(with_messages(study.study))
app.command("transfer", epilog=transfer.EXAMPLES)(with_messages(transfer.transfer))


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
