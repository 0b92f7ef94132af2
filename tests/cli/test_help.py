"""The help of every command works, and its examples use existing commands and options."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import typer

from glsim.cli import load_commands, main


def commands(group: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command and group below a group: its words after ``glsim``, and itself."""
    for name, command in group.commands.items():
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from commands(command, *path, name)


COMMANDS = dict(commands(load_commands()))


def examples(epilog: str) -> list[list[str]]:
    """Return the words that ``glsim`` gets of each example line, as bash passes them."""
    lines = re.findall(r"^(?:[A-Z_]+=\S+ )?glsim .*$", epilog, re.MULTILINE)
    lines = [re.split(r"\s{2,}| > ", line)[0] for line in lines]
    script = "glsim() { printf '%s\\n' \"$@\"; echo; }\n" + "\n".join(lines)
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return [block.splitlines() for block in done.stdout.split("\n\n")[:-1]]


def parse(words: list[str]) -> None:
    """Parse a command line with all types, without running it.

    Raises LookupError for an unknown command, TyperException for wrong arguments.
    """
    for length in (1, 2):
        command = COMMANDS.get(tuple(words[:length]))
        if command is not None and not hasattr(command, "commands"):
            with suppress(typer.Exit):  # --list prints and ends
                command.make_context("glsim", words[length:])
            return
    raise LookupError(f"no command: {words}")


EXAMPLES: list[Any] = [
    pytest.param(words, id=shlex.join(words))
    for words in examples("\n".join(command.epilog or "" for command in COMMANDS.values()))
]


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_every_command_has_help_with_defaults_and_an_example_of_itself(
    path: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    command = COMMANDS[path]
    assert main([*path, "--help"]) == 0
    assert "Usage" in capsys.readouterr().out
    for parameter in command.params:
        help = getattr(parameter, "help", "")
        assert help or parameter.name == "help", parameter.name
        optional = parameter.param_type_name == "option" and not parameter.required
        if optional and not getattr(parameter, "is_flag", False):
            shown = parameter.default is not None or "Default" in help
            assert shown or "Repeatable" in help, parameter.name
    if not hasattr(command, "commands"):
        names = [parameter.name for parameter in command.params if parameter.name != "help"]
        assert names[-3:] == ["quiet", "verbose", "debug"]
        lines = examples(command.epilog or "")
        assert [words for words in lines if tuple(words[: len(path)]) == path]


@pytest.mark.parametrize("words", EXAMPLES)
def test_examples_name_existing_commands_and_options(words: list[str]) -> None:
    parse(words)
    with pytest.raises((LookupError, typer.TyperException)):
        parse([*words, "--no-such-option"])


def test_settings_of_examples_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("glsim.cli.generate._measured_cost", lambda *_: None)  # draws frames
    few = ["--plan", "--subjects", "2", "--frames-per-subject", "2"]
    for parameters in EXAMPLES:
        words = parameters.values[0]
        if words[0] == "generate" and "--root" not in words and "people" not in words:
            assert main([*words, *few]) == 0


def test_the_list_of_commands_imports_none_of_them() -> None:
    """Heavy packages make the first help wait."""
    code = (
        "import sys; from glsim.cli import main; main(['--help']);"
        "print(*(m for m in ('numpy', 'pydantic', 'cv2', 'moderngl', 'torch') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""
    for path in COMMANDS:
        if len(path) == 1:
            assert re.search(rf"^│ {path[0]} .*\.", done.stdout, re.MULTILINE), path


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"glsim {version('glsim')}\n"
