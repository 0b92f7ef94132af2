"""The ``glsim`` command. Each sub-command has a file of its own, imported when it runs."""

from __future__ import annotations

import sys
import traceback
from importlib import import_module

import typer

from glsim.cli import (
    corrupt,
    describe,
    fit,
    generate,
    importing,
    inspecting,
    preview,
    render,
    reproduce,
    validate,
)
from glsim.cli.common import console, options
from glsim.errors import ConfigError, GlsimError

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
app.command("corrupt", epilog=corrupt.EXAMPLES)(corrupt.corrupt)
app.command("validate", epilog=validate.EXAMPLES)(validate.validate)
app.command("reproduce", epilog=reproduce.EXAMPLES)(reproduce.reproduce)
app.command("fit", epilog=fit.EXAMPLES)(fit.fit)
app.command("inspect", epilog=inspecting.EXAMPLES)(inspecting.inspect)
app.add_typer(importing.app, name="import")
app.command("sensors", epilog=describe.SENSORS_EXAMPLES)(describe.sensors)
app.command("stages", epilog=describe.STAGES_EXAMPLES)(describe.stages)
app.command("info", epilog=describe.INFO_EXAMPLES)(describe.info)
# The layers above the simulator bring their commands; it knows them by name only.
import_module("glsim.train.commands").register(app)
import_module("glsim.eval.commands").register(app)


#: What Typer makes of Ctrl-C.
_INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Run a command line; the exit status: 0 done, 1 failed or interrupted, 2 wrong usage.

    This is the one place where glsim's errors become a line on stderr.
    """
    try:
        result = app(args=arguments, standalone_mode=False)
        if result == _INTERRUPTED:
            raise KeyboardInterrupt
        return result if isinstance(result, int) else 0
    except typer.TyperException as error:  # a command line that it cannot read
        message = getattr(error, "format_message", error.__str__)()
        if message:  # a bare ``glsim`` has printed its help and says nothing more
            sys.stderr.write(f"glsim: error: {message} (see --help)\n")
        return 2
    except (KeyboardInterrupt, typer.Abort):
        console.print("interrupted: run the same command again to go on", style="yellow")
        return 1
    except GlsimError as error:
        return _fail(error, 2 if isinstance(error, ConfigError) else 1)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output left, e.g. ``| head``
        return 0
    except Exception as error:
        return _fail(error, 1)


def _fail(error: Exception, status: int) -> int:
    if options.debug:
        traceback.print_exception(error)
    known = isinstance(error, GlsimError)
    text = str(error) if known else f"{type(error).__name__}: {error} (a bug; --debug shows where)"
    sys.stderr.write(f"glsim: error: {text}\n")
    return status
