"""What the commands share: verbosity, the options that many of them have."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.logging import RichHandler

from glsim.errors import ConfigError

#: Everything for people goes to stderr; stdout is for what a command was asked to print.
console = Console(stderr=True, highlight=False)


@dataclass
class _Options:
    quiet: bool = False
    debug: bool = False


options = _Options()


def _set_quiet(value: bool) -> bool:
    options.quiet = value
    return value


def _set_verbose(value: bool) -> bool:
    if value:
        handler = RichHandler(console=console, show_path=False, show_time=False)
        logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=[handler])
    return value


def _set_debug(value: bool) -> bool:
    options.debug = value
    if value:
        handler = RichHandler(console=console)
        logging.basicConfig(level=logging.DEBUG, format="%(message)s", handlers=[handler])
    return value


Quiet = Annotated[
    bool, typer.Option("-q", "--quiet", help="Print errors only.", callback=_set_quiet)
]
Verbose = Annotated[
    bool, typer.Option("-v", "--verbose", help="Say what is found.", callback=_set_verbose)
]
Debug = Annotated[
    bool, typer.Option("--debug", help="Show tracebacks and all logs.", callback=_set_debug)
]
SensorOption = Annotated[
    str | None,
    typer.Option("--sensor", "-s", help="A shipped sensor (glsim sensors) or a .toml file."),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Set a parameter: stage.parameter=2.5, pose.yaw_deg={uniform=[-30,30]}, "
        "scene.wall_mm=1500, rig.deliver=raw. Repeatable.",
    ),
]
SeedOption = Annotated[int | None, typer.Option(help="Same seed, same bytes.")]
ConfigOption = Annotated[Path | None, typer.Option("--config", help="Settings from a TOML file.")]
BackendOption = Annotated[
    str | None, typer.Option(help="egl or osmesa; default: GLSIM_BACKEND, or what works.")
]


def overrides(**values: Any) -> dict[str, Any]:
    """Options that were given, nested: output__crop=128 is {"output": {"crop": 128}}."""
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


def say(text: str) -> None:
    """A line for people, unless --quiet; one line in a log too, however long."""
    if not options.quiet:
        console.print(text, soft_wrap=True)


def listed(paths: Sequence[Path]) -> None:
    """Name the files that were written."""
    for path in paths:
        say(f"wrote {path}")


def words(text: str | None) -> list[str] | None:
    """A comma-separated option as a list."""
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts:
        raise ConfigError(f"{text!r}: give at least one name")
    return parts


def two_numbers(option: str, text: str) -> tuple[float, float]:
    """An option of the form x,y. Raises ConfigError."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"{option} {text}: give two numbers, x,y") from None
    return x, y
