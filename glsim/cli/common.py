"""Options that several commands share, messages, and exit status of errors."""

from __future__ import annotations

import functools
import inspect
import logging
import math
import re
import signal
import sys
import threading
import tomllib
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin

import typer
from rich.console import Console
from typer.core import TyperCommand

from glsim.core.errors import (
    ConfigError,
    GlsimError,
    UnknownSettingError,
    did_you_mean,
    one_line,
    require_package,
    with_mesh_option,
)

if TYPE_CHECKING:
    from rich.table import Table


def make_console(
    *, stderr: bool = False, width: int | None = None, soft_wrap: bool = False
) -> Console:
    """Create a console that prints text unchanged: paths may contain [brackets] and :colons:.

    Markup is off everywhere: give ``style`` or a ``rich.text.Text`` instead. ``width``: number of
    columns if the output is no terminal. With ``soft_wrap``, lines are never broken.
    """
    plain = functools.partial(
        Console, stderr=stderr, highlight=False, markup=False, emoji=False, soft_wrap=soft_wrap
    )
    made = plain()
    return made if width is None or made.is_terminal else plain(width=width)


#: Messages go to stderr; stdout is for the output that the user asked for.
console = make_console(stderr=True)


@dataclass
class MessageOptions:
    """The amount of messages that a command prints, and what stands before options of meshes."""

    quiet: bool = False
    verbose: bool = False
    debug: bool = False
    mesh_option: str = ""


options = MessageOptions()
_QUIET = "Print errors only."
_VERBOSE = "Log detected units, axes and decisions."
_DEBUG = "Show tracebacks and all log messages."


def _set_messages(
    *,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", hidden=True, help=_QUIET)] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", hidden=True, help=_VERBOSE)] = False,
    debug: Annotated[bool, typer.Option("--debug", hidden=True, help=_DEBUG)] = False,
) -> None:
    options.quiet, options.verbose, options.debug = quiet, verbose, debug
    if verbose or debug:
        from rich.logging import RichHandler

        handler = RichHandler(console=console, show_path=debug, show_time=debug)
        level = logging.DEBUG if debug else logging.INFO
        logging.basicConfig(level=level, format="%(message)s", handlers=[handler])


#: Examples by command; help of options that several commands share, by the name of the parameter.
_EXAMPLES, _SHARED = (
    tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))
    for name in ("examples.toml", "options.toml")
)


def _documented(parameter: inspect.Parameter, help: str) -> inspect.Parameter:
    """Add help text to a parameter of a command; a parameter without default is an argument."""
    annotation, info = parameter.annotation, None
    if get_origin(annotation) is Annotated:
        annotation, info = get_args(annotation)
    if info is None:
        required = parameter.default is inspect.Parameter.empty
        info = typer.Argument() if required else typer.Option()
    info = copy(info)
    info.help = info.help or help
    return parameter.replace(annotation=Annotated[annotation, info])


def with_messages(command: Callable[..., int | None]) -> Callable[..., int | None]:
    """Add to a command the help texts of its docstring, and --quiet, --verbose and --debug."""
    own = inspect.signature(command, eval_str=True)
    shared = inspect.signature(_set_messages, eval_str=True).parameters

    @functools.wraps(command)
    def wrapped(**values: Any) -> int | None:
        _set_messages(**{name: values.pop(name) for name in shared})
        return command(**values)

    wrapped.__doc__, _, section = (inspect.getdoc(command) or "").partition("\n\nArgs:\n")
    helps = re.findall(r"^ {4}(\w+): (.+(?:\n {8}.+)*)", section, re.MULTILINE)
    texts = _SHARED | {name: " ".join(text.split()) for name, text in helps}
    # Typer reads a command's options from its signature.
    parameters = [
        _documented(each, texts[each.name]) if each.name in texts else each
        for each in own.parameters.values()
    ]
    parameters += shared.values()
    wrapped.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {each.name: each.annotation for each in parameters}
    return wrapped


class PlainCommand(TyperCommand):
    """A command whose help names an argument FRAMES and its type <path>."""

    def get_help(self, ctx: Any) -> str:
        """Return the help of Typer without {frames} and <list[Path]>."""
        usage, _, rest = super().get_help(ctx).partition("\n")
        rest = re.sub(r"<list\[(\w+)\]>", lambda m: f"<{m[1].lower()}>      ", rest)
        return re.sub(r"\{(\w+)\}", lambda m: m[1].upper(), usage) + "\n" + rest


def _names(module: str, function: str) -> Callable[[str], list[str]]:
    return lambda incomplete: [
        name for name in getattr(import_module(module), function)() if name.startswith(incomplete)
    ]


SENSORS = _names("glsim.sensors.sensor", "sensor_names")
STAGES = _names("glsim.noise.registry", "stage_names")
PRESETS = _names("glsim.settings.presets", "preset_names")
RECIPES = _names("glsim.train.recipe", "recipe_names")


def epilog(command: str) -> str:
    """Format the end of a command's help: examples, and options of all commands."""
    shared = "All commands take -q (errors only), -v (decisions), --debug (tracebacks)."
    return f"\b\nExamples:\n{_EXAMPLES[command].strip()}\n\n{shared}"


SensorOption = Annotated[
    str | None,
    typer.Option(
        "--sensor", "-s", autocompletion=SENSORS,
        help="A sensor (glsim sensors) or a .toml file. Default: kinect-v2.",
    ),
]  # fmt: skip
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Set a parameter, such as tof_floor.sigma_mm=2, 'pose.yaw_deg={uniform=[-30,30]}', "
        "scene.wall_mm=1500. Repeatable.",
    ),
]
RotationOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Turns of the mesh about x (left), y (up) and z (forward) after the axes, degrees. "
        "Default: found if the axes are.",
    ),
]
PresetOption = Annotated[
    str | None,
    typer.Option(
        "--preset", autocompletion=PRESETS,
        help="Start from shipped settings (glsim presets). Default: none.",
    ),
]  # fmt: skip

#: Exit status that Typer returns for Ctrl-C.
_INTERRUPTED = 130
#: Command -> what stands before unit=... and axes=... of ``glsim.load_mesh`` when they are typed.
_MESH_OPTIONS = {"generate": "--set source.", "inspect": "--", "render": "--"}
#: Command -> how an interrupted run goes on; the other commands begin anew.
_GOES_ON = {
    "train": "run it again with --resume to go on",
    "tune": "the same command has its last settings",
    **dict.fromkeys(("eval", "generate", "import", "paper"), "run the same command again to go on"),
}


def run_command_line(command: Callable[..., Any], arguments: list[str] | None) -> int:
    """Run a command line of ``glsim``; return the exit status.

    The status is 0 after success, 1 after a failure or an interruption, 2 for wrong usage. This is
    the only place that turns errors of glsim into a line on stderr.
    """
    terminated: list[int] = []

    def terminate(number: int, _frame: FrameType | None) -> None:
        terminated.append(number)
        raise KeyboardInterrupt  # as for Ctrl-C: ends workers, removes temporary files

    _print_any_character()
    words = list(sys.argv[1:] if arguments is None else arguments)
    if len(words) > 1 and words[0] in ("-q", "-v", "--debug"):  # all commands take them
        words.append(words.pop(0))
    options.mesh_option = _MESH_OPTIONS.get(words[0] if words else "", "")
    try:
        with _on_sigterm(terminate):
            result = command(args=words, standalone_mode=False)
        if result == _INTERRUPTED:
            raise KeyboardInterrupt
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except typer.TyperException as error:  # wrong usage
        message = _option_advice(error, words)
        message = message or getattr(error, "format_message", error.__str__)()
        if message:  # ``glsim`` without arguments prints its help and has no message
            sys.stderr.write(f"glsim: error: {message} (see --help)\n")
        return 2
    except (KeyboardInterrupt, typer.Abort):
        how = "terminated" if terminated else "interrupted"
        again = _GOES_ON.get(words[0] if words else "", "the same command would begin anew")
        console.print(f"{how}: {again}", style="yellow")
        return 1
    except GlsimError as error:
        return _report_error(error, 2 if isinstance(error, ConfigError) else 1)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of the pipe has ended, e.g. ``| head``
        return 0
    except Exception as error:
        return _report_error(error, 1)


def _option_advice(error: typer.TyperException, arguments: list[str]) -> str | None:
    """Return the advice for an unknown option that is a setting, or the start of another."""
    context = getattr(error, "ctx", None)
    command = getattr(context, "info_name", "")
    option = getattr(error, "option_name", "")
    known = [name for param in context.command.params for name in param.opts] if context else []
    extra = re.search(r"extra argument\S* \(([^\s)]+)", str(error))
    param = getattr(error, "param", None)
    if param is not None and param.nargs > 1:
        return f"{param.opts[0]}: give {param.nargs} numbers, {param.metavar}"
    broken = extra and rf"\S*[\[{{][^\s\]}}]* {re.escape(extra[1])}"
    if broken and (split := re.search(broken, " ".join(arguments))):
        return f"{split[0]}: the shell splits this value: quote all of it, '...'"
    if extra and command == "generate":
        return f"{extra[1]}: to name the folder of the data set, give -o {extra[1]}"
    if longer := [name for name in known if len(option) > 2 and name.startswith(option)]:
        return f"No such option: {option}, did you mean {' or '.join(longer)}?"
    if not option or "--set" not in known or command == "train":
        return None
    from glsim.core.camera import DEFAULT_SENSOR
    from glsim.sensors.sensor import load_sensor, stage_parameters
    from glsim.settings.schema import Settings
    from glsim.settings.toml_tables import dotted_names

    wanted = option.removeprefix("--").replace("-", "_")
    names = [*dotted_names(Settings), *stage_parameters(load_sensor(DEFAULT_SENSOR).stages)]
    named = [name for name in names if name.split(".")[-1] == wanted]
    words = [*" ".join(arguments).partition(option)[2].replace("=", " ", 1).split(), "VALUE"]
    return f"{option} is a setting: --set {named[0]}={words[0]}" if named else None


def _print_any_character() -> None:
    """Print ? for characters that the terminal cannot encode, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


@contextmanager
def _on_sigterm(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Handle SIGTERM within the block, in the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _report_error(error: Exception, status: int) -> int:
    if options.debug:
        traceback.print_exception(error)
    sys.stderr.write(f"glsim: error: {as_typed(_error_text(error))}\n")
    return status


def as_typed(text: str) -> str:
    """Write URLs (pathlib drops a slash) and mesh options in a message as the user types them."""
    if options.mesh_option:
        text = with_mesh_option(text, options.mesh_option)
    return re.sub(r"\b(s3a?|gs|gcs|az|abfss?):/(?=[^/\s])", r"\1://", text)


def _error_text(error: Exception) -> str:
    """Describe an error in one line; only unexpected errors are called a bug."""
    if isinstance(error, GlsimError):
        return _with_stage(error) if isinstance(error, UnknownSettingError) else str(error)
    if isinstance(error, MemoryError):
        return "out of memory: ask for fewer frames, fewer workers or a smaller crop"
    if isinstance(error, OSError) and error.strerror:
        place = f"{error.filename}: " if error.filename else ""
        return f"{place}{error.strerror}"
    return f"{one_line(error)} (a bug; --debug shows where)"


def _with_stage(error: UnknownSettingError) -> str:
    """Name a parameter of the chosen sensor's stages that is called as an unknown setting."""
    from glsim.sensors.sensor import load_sensor, stage_parameters

    text, names = str(error), list[str]()
    with suppress(GlsimError):
        names = stage_parameters(load_sensor(error.sensor).stages) if error.sensor else []
    advice = did_you_mean(error.name, (), elsewhere=names)
    if not advice.startswith("did"):
        return text
    before, known, _ = text.partition(" (known: ")
    return f"{before} ({advice})" if known else f"{text[:-2]} or {advice[13:]})"


def overrides(**values: Any) -> dict[str, Any]:
    """Nest the options of a command: output__crop=128 becomes {"output": {"crop": 128}}."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        if value is None:
            continue
        *tables, key = name.split("__")
        node = tree
        for table in tables:
            node = node.setdefault(table, {})
        node[key] = value
    return tree


def print_message(text: str) -> None:
    """Print a message on stderr unless --quiet, without line breaks at any length."""
    if not options.quiet:
        console.print(as_typed(text), soft_wrap=True)


def print_written(paths: Sequence[Path]) -> None:
    """Print the names of written files."""
    for path in paths:
        print_message(f"wrote {path}")


def split_names(text: str | None) -> list[str] | None:
    """Split a comma-separated option. Raises ConfigError if no name is left."""
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts:
        raise ConfigError(f"{text!r}: give at least one name")
    return parts


def two_numbers(option: str, text: str, *, or_one: bool = False) -> tuple[float, float]:
    """Parse an option of the form x,y, or of a number for both. Raises ConfigError."""
    try:
        both = f"{text},{text}" if or_one and "," not in text else text
        x, y = (float(part) for part in both.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ConfigError(f"{option} {text}: give {'one number or ' * or_one}two numbers, x,y")
    return x, y


JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON for other programs instead of a table.")
]
JsonFileOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Write all numbers as JSON; - prints them instead of a table. Default: no file.",
    ),
]


def _check_figure(file: Path | None) -> Path | None:
    if file is not None:
        require_package("matplotlib", "--figure", "eval")
    return file


FigureOption = Annotated[
    Path | None,
    typer.Option(
        "--figure", metavar="FILE.png", callback=_check_figure,
        help="Draw real or published beside simulated on one page. Default: no file.",
    ),
]  # fmt: skip
#: Value of JsonFileOption that means stdout.
STDOUT = Path("-")


def print_json(content: object) -> None:
    """Print a JSON value to stdout, NaN as null."""
    from glsim.core.files.atomic import json_text

    sys.stdout.write(json_text(content).decode())


def check_outputs(*files: Path | None) -> None:
    """Raise DatasetError for an output file that cannot be written; skip None and ``STDOUT``."""
    from glsim.core.files.atomic import check_can_write

    for file in files:
        if file is not None and file != STDOUT:
            check_can_write(file)


def check_new(out: Path) -> None:
    """Raise ConfigError if the sensor file to write exists, or its name does not end in .toml."""
    if out.suffix != ".toml":
        raise ConfigError(f"-o {out}: give a name that ends in .toml")
    if out.exists():
        raise ConfigError(f"-o {out}: is there already: choose another name, or remove it")


def replaced(out: Path) -> str:
    """Return what a message about an output adds if it is there before it is written."""
    there = any(out.iterdir()) if out.is_dir() else out.exists()
    return "; what had the same name is replaced" if there else ""


def write_json(content: object, file: Path) -> list[Path]:
    """Write a JSON value to a file or stdout; return the written files. Raises DatasetError."""
    if file == STDOUT:
        print_json(content)
        return []
    from glsim.core.files.atomic import json_text, write_atomic

    write_atomic(json_text(content), file)
    return [file]


def print_table(table: Table) -> None:
    """Print a table to stdout; piped tables have 200 columns, so that grep finds whole words."""
    make_console(width=200).print(table)
