"""Options of every command, the version, and completion of words by a shell."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.cli.common import options, with_messages
from glsim.errors import ConfigError

#: Starts the command line as an installed ``glsim`` does: shells ask the command by its name.
START = "import sys; sys.argv[0] = 'glsim'; from glsim.__main__ import main; sys.exit(main())"


@pytest.fixture(autouse=True)
def _options_as_before() -> Iterator[None]:
    before = replace(options)
    yield
    vars(options).update(vars(before))


def test_shared_options_hold_for_one_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sensors", "-q"]) == 0
    assert options.flags == ["-q"]
    assert main(["stages", "no_such_stage", "--debug"]) == 2
    assert options.flags == ["--debug"]
    assert "Traceback" in capsys.readouterr().err
    assert main(["stages", "no_such_stage"]) == 2
    assert options.flags == []
    assert "Traceback" not in capsys.readouterr().err


def test_a_command_keeps_its_exit_status_and_errors() -> None:
    seen = []

    def command(path: str, *, fail: bool = False) -> int:
        seen.append(path)
        if fail:
            raise ConfigError("as asked")
        return 1

    wrapped = with_messages(command)
    assert wrapped(path="a", quiet=True, verbose=False, debug=False) == 1
    assert options.quiet
    with pytest.raises(ConfigError, match="as asked"):
        wrapped(path="b", fail=True, quiet=False, verbose=False, debug=False)
    assert seen == ["a", "b"]
    assert not options.quiet


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"glsim {version('glsim')}\n"


def completed(shell: str, **asked: str) -> str:
    """What the command prints when a shell asks it for the next words."""
    variables = {"_GLSIM_COMPLETE": f"complete_{shell}", **asked}
    done = subprocess.run(
        [sys.executable, "-c", START],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return done.stdout


def test_bash_completes_commands_and_options() -> None:
    assert completed("bash", COMP_WORDS="glsim gen", COMP_CWORD="1").split() == ["generate"]
    words = completed("bash", COMP_WORDS="glsim denoise --", COMP_CWORD="2").split()
    assert {"--uncertainty", "--quiet", "--debug"} <= set(words)


def test_bash_completes_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of sensors, stages, recipes and presets; of files, where a file may stand, too."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kinect-mine.toml").write_text("")
    (tmp_path / "kinect.png").write_text("")
    (tmp_path / "kin").mkdir()
    (tmp_path / "kin" / "b.toml").write_text("")
    for words in ("generate --sensor", "validate", "sensors", "tune"):
        line = f"glsim {words} kin"
        found = completed("bash", COMP_WORDS=line, COMP_CWORD=str(line.count(" "))).split()
        assert {"kinect-v2", "kinect-v1", "kinect-mine.toml", "kin/"} <= {*found}
        assert "kinect.png" not in found
        assert "azure-kinect" not in found
    found = completed("bash", COMP_WORDS="glsim sensors kin/", COMP_CWORD="2").split()
    assert found == ["kin/b.toml"]
    for line, word in (
        ("glsim stages tof_l", "tof_light"),
        ("glsim train paper-d7", "paper-d7-small"),
        ("glsim render --preset off", "office"),
    ):
        assert word in completed("bash", COMP_WORDS=line, COMP_CWORD=str(line.count(" "))).split()


def test_zsh_and_fish_complete_commands() -> None:
    assert '"render"' in completed("zsh", _TYPER_COMPLETE_ARGS="glsim ren")
    assert "transfer" in completed(
        "fish", _TYPER_COMPLETE_ARGS="glsim tran", _TYPER_COMPLETE_FISH_ACTION="get-args"
    )


def test_the_script_for_bash_completes_in_bash(tmp_path: Path) -> None:
    """``glsim --show-completion``, run from bash, prints a script that bash loads."""
    command = tmp_path / "glsim"
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -c "{START}" "$@"\n')
    command.chmod(0o755)
    script = """eval "$(glsim --show-completion)"
COMP_WORDS=(glsim ver) COMP_CWORD=1
_glsim_completion glsim
echo "${COMPREPLY[@]}"
"""
    done = subprocess.run(
        ["bash", "-c", script],
        env=os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["verify"]
