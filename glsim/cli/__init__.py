"""The ``glsim`` command line. Each sub-command has its own file and imports packages when run."""

from __future__ import annotations

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
from glsim.cli.common import run_command_line

app = typer.Typer(
    name="glsim",
    help="3D faces in, paired clean and noisy 16-bit depth frames out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("render", epilog=render.EXAMPLES)(render.render)
app.command("generate", epilog=generate.EXAMPLES)(generate.generate)
app.command("preview", epilog=preview.EXAMPLES)(preview.preview)
app.command("verify", epilog=verify.EXAMPLES)(verify.verify)
app.command("corrupt", epilog=corrupt.EXAMPLES)(corrupt.corrupt)
app.command("validate", epilog=validate.EXAMPLES)(validate.validate)
app.command("compare", epilog=compare.EXAMPLES)(compare.compare)
app.command("reproduce", epilog=reproduce.EXAMPLES)(reproduce.reproduce)
app.command("tune", epilog=tune.EXAMPLES)(tune.tune)
app.command("fit", epilog=fit.EXAMPLES)(fit.fit)
app.command("inspect", epilog=inspect.EXAMPLES)(inspect.inspect)
app.add_typer(import_.app, name="import")
app.command("sensors", epilog=sensors.EXAMPLES)(sensors.sensors)
app.command("stages", epilog=stages.EXAMPLES)(stages.stages)
app.command("info", epilog=info.EXAMPLES)(info.info)
app.command("train", epilog=train.EXAMPLES)(train.train)
app.command("eval", epilog=evaluate.EXAMPLES)(evaluate.evaluate)
app.command("denoise", epilog=denoise.EXAMPLES)(denoise.denoise)
app.command("export", epilog=export.EXAMPLES)(export.export)
app.command("study", epilog=study.EXAMPLES)(study.study)
app.command("transfer", epilog=transfer.EXAMPLES)(transfer.transfer)


def main(arguments: list[str] | None = None) -> int:
    """Run a command line (default: that of the process); returns the exit status 0, 1 or 2."""
    return run_command_line(app, arguments)
