"""Reference of the command line, from the Typer application."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from glsim.cli import load_commands
from scripts.reference.markdown import block, code, plain, table

_INTRODUCTION = """\
# Command line

`glsim COMMAND --help` prints the same. Exit status: 0 = done, 1 = failed or interrupted, 2 =
wrong usage or settings. Messages go to stderr, tables to stdout.

"""


@cache  # it imports all commands
def commands() -> tuple[tuple[str, Any], ...]:
    """Return the name of each command, such as "import biwi", and the command, sorted."""
    return tuple(_walk(load_commands(), ""))


def options_of(command: Any) -> set[str]:
    """Return all option names of a command, with their dashes."""
    names = {name for p in command.params for name in (*p.opts, *p.secondary_opts)}
    return {name for name in names if name.startswith("-")} | {"-h", "--help"}


def pages() -> dict[str, str]:
    """Return page name -> Markdown: one page with all commands."""
    entries = commands()
    rows = [
        [f"[`glsim {name}`](#{_anchor(name)})", plain(_first_line(command))]
        for name, command in entries
    ]
    text = _INTRODUCTION + table(["command", "what it does"], rows)
    return {"commands": text + "".join(_section(name, command) for name, command in entries)}


def _walk(group: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    for name, command in sorted(group.commands.items()):
        if hasattr(command, "commands"):
            yield from _walk(command, f"{prefix}{name} ")
        else:
            yield f"{prefix}{name}", command


def _anchor(name: str) -> str:
    return "glsim-" + name.replace(" ", "-")


def _first_line(command: Any) -> str:
    return str(command.help or "").strip().split("\n\n")[0]


def _section(name: str, command: Any) -> str:
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(_argument(p) for p in arguments)
    parts = [f"## `glsim {name}`\n\n"]
    parts += [plain(part) + "\n\n" for part in str(command.help or "").strip().split("\n\n")]
    parts.append(block(f"glsim {name} [OPTIONS] {usage}".strip(), "text"))
    examples = (command.epilog or "").partition("Examples:\n")[2].rpartition("\n\n")[0]
    if examples:
        parts.append(block(re.sub(r"\n\n+", "\n", examples), "text"))
    rows = [_row(p) for p in command.params]
    parts.append(table(["argument or option", "value", "default", "meaning"], rows))
    return "".join(parts)


def _argument(parameter: Any) -> str:
    name = parameter.metavar or parameter.name.upper()
    name += "..." if parameter.nargs == -1 else ""
    return name if parameter.required else f"[{name}]"


def _row(parameter: Any) -> list[str]:
    if parameter.param_type_name == "argument":
        names = code(_argument(parameter))
    else:
        names = ", ".join(map(code, (*parameter.opts, *parameter.secondary_opts)))
    flag = getattr(parameter, "is_flag", False)
    annotation = getattr(parameter.type_descriptor.annotation, "__name__", "")
    kinds = {
        "str": "text",
        "int": "whole number",
        "float": "number",
        "Path": "path",
        "list": "path",
    }
    kind = "" if flag else parameter.metavar or kinds.get(annotation, annotation)
    if parameter.min is not None:
        kind += f", at least {parameter.min:g}"
    if parameter.max is not None:
        kind += f", at most {parameter.max:g}"
    default = parameter.default
    shown = "" if default in (None, False) or parameter.required else code(default)
    note = "required. " if parameter.required and parameter.param_type_name != "argument" else ""
    return [names, plain(kind), shown, note + plain(parameter.help or "")]
