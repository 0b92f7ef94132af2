"""The ``glsim`` command line: each command has its own file, which is imported when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from glsim.cli.common import PlainCommand, epilog, run_command_line, with_messages

#: Command -> its heading in the help, its module and function (or group), and its description.
_COMMANDS = {
    "generate": ("Make data", "generate:generate", "Generate a data set; run again to resume it."),
    "render": ("Make data", "render:render", "Render one mesh to clean and noisy depth."),
    "corrupt": ("Make data", "corrupt:corrupt", "Add the noise of a sensor to depth maps."),
    "verify": ("Make data", "verify:verify", "Check a data set: files, counts, checksums."),
    "preview": ("Make data", "preview:preview", "Draw a contact sheet of a data set."),
    "inspect": ("Make data", "inspect:inspect", "Detect the kind of a face set; draw faces."),
    "export": ("Make data", "export:export", "Export frames, or a trained network."),
    "fetch": ("Make data", "fetch:fetch", "Fetch what glsim does not bring, once."),
    "import": ("Make data", "import_:app", "Convert real depth maps to a data set."),
    "sensors": ("Sensors", "sensors:sensors", "List the sensors, or print one."),
    "presets": ("Make data", "presets:presets", "List shipped settings, or print some."),
    "stages": ("Sensors", "stages:stages", "List the noise stages and their parameters."),
    "validate": ("Sensors", "validate:validate", "Check a sensor against published noise."),
    "compare": ("Sensors", "compare:compare", "Measure two sets of depth frames."),
    "fit": ("Sensors", "fit:fit", "Fit a sensor file to recordings of a camera."),
    "tune": ("Sensors", "tune:tune", "Change a sensor's noise in a browser."),
    "info": ("Sensors", "info:info", "Print versions and working OpenGL back ends."),
    "denoise": ("Denoise", "denoise:denoise", "Denoise depth maps; 0 means no depth."),
    "adapt": ("Denoise", "adapt:adapt", "Adapt a network to your camera's frames."),
    "train": ("Denoise", "train:train", "Train a denoiser."),
    "eval": ("Denoise", "eval:evaluate", "Score denoisers on a data set."),
    "eval-real": ("Denoise", "eval_real:evaluate_real", "Score denoisers on real frames."),
    "paper": ("Denoise", "paper:app", "Reproduce the paper's tables and figures."),
}


class _Commands(TyperGroup):
    """Group of all commands, whose names are listed without importing any command."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the options of the group; --show-completion is hidden in the help."""
        params: list[Any] = super().get_params(ctx)
        for param in params:
            param.hidden = param.name == "show_completion"
        return params

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the name of the command, the imported command, and its arguments."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, load_command(str(name)), rest


app = typer.Typer(
    name="glsim", cls=_Commands, no_args_is_help=True, pretty_exceptions_enable=False,
    rich_markup_mode="rich", context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
for _name, (_heading, _, _help) in _COMMANDS.items():
    app.command(_name, help=_help, rich_help_panel=_heading)(lambda: None)


def load_command(name: str) -> Any:
    """Import a command and return it as a command of click."""
    module, _, attribute = _COMMANDS[name][1].partition(":")
    imported = import_module(f"glsim.cli.{module}")
    command = getattr(imported, attribute)
    if not isinstance(command, typer.Typer):
        single = typer.Typer(add_completion=False, rich_markup_mode=None)
        single.command(name, cls=PlainCommand, epilog=epilog(name))(with_messages(command))
        command = single
    return typer.main.get_command(command)


def load_commands() -> Any:
    """Import all commands and return the group that holds them."""
    group: Any = typer.main.get_command(app)
    group.commands = {name: load_command(name) for name in _COMMANDS}
    return group


def _print_version(asked: bool) -> None:
    if asked:
        from glsim.data.code_version import code_version

        typer.echo(f"glsim {code_version()}")
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
    """Generate pairs of clean and noisy 16-bit depth frames from 3D faces.

    All commands take -q (errors only), -v (decisions) and --debug (tracebacks).
    """


def main(arguments: list[str] | None = None) -> int:
    """Run a command line (default: the process's arguments); return the exit status 0, 1 or 2."""
    return run_command_line(app, arguments)
