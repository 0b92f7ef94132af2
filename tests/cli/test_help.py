"""The help of every command works, and its examples use existing commands and options."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import typer
from rich.text import Text

from glsim.cli import app, main
from glsim.cli.common import MORE
from glsim.cli.old_spellings import new_spelling

#: Files in glsim/cli that are no commands.
SHARED_FILES = {
    "__init__", "common", "completion", "figures", "generate_parts", "generate_plan",
    "generation_summary",
    "old_spellings", "progress", "streams"}  # fmt: skip


def commands(group: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command and group below a group: its words after ``glsim``, and itself."""
    for name, command in group.commands.items():
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from commands(command, *path, name)


ROOT: Any = typer.main.get_command(app)
COMMANDS = dict(commands(ROOT))


def example_lines(epilog: str) -> list[str]:
    """Return the example lines of an epilog, without remarks."""
    lines = re.findall(r"^(?:[A-Z_]+=\S+ )?glsim .*$", epilog, re.MULTILINE)
    return [re.split(r"\s{2,}", line)[0] for line in lines]


def through_bash(lines: list[str]) -> list[list[str]]:
    """Return the words that ``glsim`` gets of each line, as a shell passes them."""
    script = "glsim() { printf '%s\\n' \"$@\"; echo; }\n" + "\n".join(lines)
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return [block.splitlines() for block in done.stdout.split("\n\n")[:-1]]


def examples(epilog: str) -> list[list[str]]:
    """Split the example lines of an epilog into the words that a shell passes."""
    return through_bash(example_lines(epilog))


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


def test_a_shell_would_take_braces_apart() -> None:
    """Why examples are quoted: bash makes two words of {a,b}."""
    assert through_bash(["glsim x --set a={b=[1,2]}", "glsim y 'a b'"]) == [
        ["x", "--set", "a=b=[1", "a=2]"],
        ["y", "a b"],
    ]


#: Examples that need no files but a stage: as they stand, data sets as a plan.
CHEAP = [
    parameters
    for parameters in EXAMPLES
    if parameters.values[0][0] in ("generate", "sensors", "stages", "info")
    and "--root" not in parameters.values[0]
]
STAGE = """#version 330 core
// mine: doubles depth.
uniform sampler2D u_depth;
out float depth;
void main() { depth = 2.0 * texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r; }
"""


@pytest.mark.parametrize("words", CHEAP)
def test_cheap_examples_run(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_noise.glsl").write_text(STAGE)
    few = ["--plan", "--subjects", "2", "--frames-per-subject", "2"]
    assert main([*words, *(few if words[0] == "generate" else [])]) == 0


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


def test_no_help_loses_words_in_brackets() -> None:
    """Rich takes [ray] for a style: 'glsim[ray]' was printed as 'glsim'."""
    for path, command in COMMANDS.items():
        texts = [command.help or "", re.sub(r"\[/?bold\]", "", command.epilog or "")]
        texts += [getattr(parameter, "help", None) or "" for parameter in command.params]
        for text in texts:
            assert Text.from_markup(text).plain == text.replace("\\[", "["), path


#: Where a help text may be read: without UTF-8, without colour, in a narrow terminal.
PLACES: dict[str, dict[str, str]] = {
    "C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "ASCII": {"PYTHONIOENCODING": "ascii"},
    "Latin 1, 40 columns": {"PYTHONIOENCODING": "latin-1", "COLUMNS": "40"},
    "no colour": {"NO_COLOR": "1", "TERM": "dumb"},
    "terminal of 40 columns": {"FORCE_COLOR": "1", "COLUMNS": "40"},
}


@pytest.mark.long
@pytest.mark.parametrize("place", PLACES)
def test_every_help_is_printed_everywhere(place: str) -> None:
    script = "import sys\nfrom glsim.cli import main\n" + "\n".join(
        f"assert main({[*path, '--help']!r}) == 0" for path in COMMANDS
    )
    script += "\nassert main(['sensors']) == main(['stages']) == main(['eval', '--list']) == 0"
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | PLACES[place],
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == b""
    assert (b"\x1b[" in done.stdout) == (place == "terminal of 40 columns")


def test_a_stream_of_ascii_prints_what_is_nearest() -> None:
    name = "d\u00e9j\u00e0 \u2026 \u9762"
    script = f"from glsim.cli import main; main(['corrupt', {name!a}, '-o', 'x.png'])"
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | PLACES["ASCII"],
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.stderr.decode("ascii") == "glsim: error: deja . ?: no such file or folder\n"


def test_every_option_has_a_help_text() -> None:
    for path, command in COMMANDS.items():
        for parameter in command.params:
            assert getattr(parameter, "help", "") or parameter.name == "help", (
                path,
                parameter.name,
            )


def test_every_command_ends_with_the_shared_options() -> None:
    for path, command in COMMANDS.items():
        names = [parameter.name for parameter in command.params if parameter.name != "help"]
        if not hasattr(command, "commands"):
            assert names[-3:] == ["quiet", "verbose", "debug"], path


def test_every_command_has_a_file_of_its_name() -> None:
    files = {file.stem for file in Path(main.__code__.co_filename).parent.glob("*.py")}
    names = {name.replace("-", "_") for name in ROOT.commands} - {"paper"}
    assert {file.rstrip("_") for file in files - SHARED_FILES} == names


def test_the_first_help_has_at_most_12_options() -> None:
    """The rest stands under a second heading."""
    for path, command in COMMANDS.items():
        first = [p for p in command.params if getattr(p, "rich_help_panel", MORE) is None]
        assert len([p for p in first if p.param_type_name == "option"]) < 12, path


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("reproduce -o out --size full", "paper reproduce -o out --size full"),
        ("reproduce -o out --figures", "paper figures out"),
        ("reproduce --findings --out=out", "paper findings out"),
        ("reproduce --filter-page -o out -q", "paper protocols out -q"),
        ("study -o study", "paper study -o study"),
        ("eval --real=frames --tune -d face", "eval-real frames --tune-filters -d face"),
        ("eval data --ssim-readings -o ssim", "paper ssim data -o ssim"),
        ("eval data --runs a --photo-runs b", "paper photographs data --runs a --photo-runs b"),
        (
            "eval data --paper-table 2 --runs runs --no-probes",
            "paper tables data --table 2 --runs runs --no-baselines",
        ),
        ("eval data --tune", "eval data --tune-filters"),
        ("paper tables data --tune", "paper tables data --tune-filters"),
    ],
)
def test_old_spellings_are_those_of_today(old: str, new: str) -> None:
    assert new_spelling(old.split()) == new.split()
    parse(new.split())


def test_present_spellings_stay_as_they_are() -> None:
    for parameters in EXAMPLES:
        assert new_spelling(parameters.values[0]) == parameters.values[0]


def test_an_old_spelling_works_and_prints_the_new_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "-o", str(tmp_path), "--plan"]) == 0
    seen = capsys.readouterr()
    assert f"this command is now: glsim paper reproduce -o {tmp_path} --plan" in seen.err
    assert seen.out.startswith("glsim generate")
