"""The help of every command works, and its examples use existing commands and options."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from glsim.cli import app, main

#: Files in glsim/cli that are no commands.
SHARED_FILES = {"__init__", "common", "generate_plan", "progress"}


def commands(group: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command and group below a group: its words after ``glsim``, and itself."""
    for name, command in group.commands.items():
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from commands(command, *path, name)


ROOT = typer.main.get_command(app)
COMMANDS = dict(commands(ROOT))


def examples(epilog: str) -> list[list[str]]:
    """Split the example lines of an epilog into words, without ``glsim`` and remarks."""
    lines = re.findall(r"^(?:[A-Z_]+=\S+ )?glsim (.*)$", epilog, re.MULTILINE)
    return [shlex.split(re.split(r"\s{2,}", line)[0]) for line in lines]


def parse(words: list[str]) -> None:
    """Parse a command line with all types, without running it.

    Raises LookupError for an unknown command, TyperException for wrong arguments.
    """
    for length in (1, 2):
        command = COMMANDS.get(tuple(words[:length]))
        if command is not None and not hasattr(command, "commands"):
            command.make_context("glsim", words[length:])
            return
    raise LookupError(f"no command: {words}")


EXAMPLES = [
    pytest.param(words, id=shlex.join(words))
    for command in COMMANDS.values()
    for words in examples(command.epilog or "")
]


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_every_command_has_help_and_an_example_of_itself(
    path: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*path, "--help"]) == 0
    assert "Usage" in capsys.readouterr().out
    if not hasattr(COMMANDS[path], "commands"):
        lines = examples(COMMANDS[path].epilog or "")
        assert [words for words in lines if tuple(words[: len(path)]) == path]


@pytest.mark.parametrize("words", EXAMPLES)
def test_examples_name_existing_commands_and_options(words: list[str]) -> None:
    parse(words)


@pytest.mark.parametrize(
    "words",
    [
        ["rendr", "face.obj"],
        ["render", "face.obj", "--rew"],
        ["import", "biwy", "hpdb", "-o", "real"],
    ],
    ids=" ".join,
)
def test_wrong_examples_would_be_noticed(words: list[str]) -> None:
    with pytest.raises((LookupError, typer.TyperException)):
        parse(words)


def test_every_option_has_a_help_text() -> None:
    for path, command in COMMANDS.items():
        for parameter in command.params:
            assert getattr(parameter, "help", "") or parameter.name == "help", (
                path,
                parameter.name,
            )


def test_every_command_has_a_file_of_its_name() -> None:
    files = {file.stem for file in Path(main.__code__.co_filename).parent.glob("*.py")}
    assert {file.rstrip("_") for file in files - SHARED_FILES} == set(ROOT.commands)
