"""The help of every command works; examples of help and pages name what there is."""

import re
import shlex
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import typer

from glsim.cli import main
from scripts.reference.commands import commands
from tests.support.imports import ROOT

COMMANDS: dict[str, Any] = dict(commands())
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def examples(text: str) -> list[list[str]]:
    """Return the words that ``glsim`` gets of each example line."""
    lines = re.findall(r"^(?:\w+=\S+ )?glsim (\w.*)$", text.replace("\\\n", ""), re.MULTILINE)
    return [shlex.split(re.split(r" > | \| | && ", line)[0], True) for line in lines]


HELP = examples("\n".join(command.epilog or "" for command in COMMANDS.values()))
BLOCKS = re.findall(
    r"```sh\n(.*?)```", "".join(page.read_text("utf-8") for page in PAGES), re.DOTALL
)


def parse(words: list[str]) -> None:
    """Parse a command line with all types, without running it.

    Raises LookupError for an unknown command, TyperException for wrong arguments.
    """
    length = 1 if words[0] in COMMANDS else 2
    command = COMMANDS.get(" ".join(words[:length]))
    if command is None:
        raise LookupError(f"no command: {words}")
    with suppress(typer.Exit):  # --list prints and ends
        command.make_context("glsim", words[length:])


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example_of_itself(name: str) -> None:
    assert main([*name.split(), "--help"]) == 0
    assert any(words[: len(name.split())] == name.split() for words in HELP)


@pytest.mark.parametrize("words", [*HELP, *examples("\n".join(BLOCKS))], ids=shlex.join)
def test_examples_name_existing_commands_and_options(words: list[str]) -> None:
    parse(words)
    with pytest.raises((LookupError, typer.TyperException)):
        parse([*words, "--no-such-option"])


def test_settings_of_examples_exist(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glsim.cli.generate._measured_cost", lambda *_: None)  # draws frames
    few = ["--plan", "--subjects", "2", "--frames-per-subject", "2"]
    for words in HELP:
        if words[0] == "generate" and "--root" not in words and "people" not in words:
            assert main([*words, *few]) == 0


@pytest.mark.parametrize(
    ("command", "parameter", "start", "name"),
    [("generate", "sensor", "kinect-v1-", "kinect-v1-nguyen"), ("tune", "sensor", "id", "ideal"),
     ("train", "recipe", "paper-d7", "paper-d7-small"), ("stages", "name", "tof_ta", "tof_taps"),
     ("generate", "preset", "of", "office"), ("presets", "name", "of", "office")],
)  # fmt: skip
def test_tab_completes_names(command: str, parameter: str, start: str, name: str) -> None:
    found = COMMANDS[command]
    (asked,) = [each for each in found.params if each.name == parameter]
    values = [item.value for item in asked.shell_complete(found.make_context("x", []), start)]
    assert name in values
    assert all(value.startswith(start) for value in values)


def test_the_start_of_an_option_and_cut_texts(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["generate", "--frames", "3"]) == 2
    assert "did you mean --frames-per-subject?" in capsys.readouterr().err
    assert main(["generate", "data"]) == 2
    assert "give -o data " in capsys.readouterr().err
    for name in ("fit", "paper", "import", "denoise"):
        main([name, "--help"])
        _, _, text = capsys.readouterr().out.partition("\n")
        assert not re.search(r"list\[|\{|\w\.\.\.$", text, re.MULTILINE)
