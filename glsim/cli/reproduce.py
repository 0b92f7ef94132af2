"""``glsim reproduce``: the paper's tables from nothing, as a series of other commands.

A plan (glsim/cli/reproductions/*.toml) holds their options:

    title = "..."                      what it makes
    seeds = [0, 1, 2]                  of every recipe
    generate = "--subjects 60 ..."     options of glsim generate
    eval = "--tune"                    options of glsim eval
    [[train]]                          groups in order; in a group seed by seed, so that every row
    recipes = ["paper-d7-small"]       has a first seed before one has a second
    options = "--steps 300"            options of glsim train

Each command resumes by itself; here is known only that a finished training is not started again.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel, ConfigDict, Field

from glsim.cli.common import Debug, Quiet, Verbose, console, say
from glsim.dataset.files import read_json
from glsim.errors import ConfigError, DatasetError, GlsimError, did_you_mean
from glsim.toml import read_toml, validate

EXAMPLES = """
[bold]Examples[/bold]

glsim reproduce -o reproduced               small: half an hour on two cores

glsim reproduce -o paper --size full        the paper's size, for a GPU

glsim reproduce -o mine --size mine.toml    a plan of your own, written as the shipped ones are

glsim reproduce -o reproduced --plan        print the commands and run none

The same command again goes on where an interrupted one stopped.
"""

_FOLDER = Path(__file__).parent / "reproductions"


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Trainings(_Table):
    """Recipes that are trained with the same options."""

    recipes: tuple[str, ...] = Field(min_length=1)
    options: str = ""


class Plan(_Table):
    """What is run, see above."""

    title: str
    seeds: tuple[int, ...] = Field((0,), min_length=1)
    generate: str
    eval: str = ""
    train: tuple[Trainings, ...] = Field(min_length=1)

    def commands(self, out: Path) -> Iterator[list[str]]:
        """The arguments of ``glsim``, in order."""
        data, runs = str(out / "data"), out / "runs"
        yield ["generate", *shlex.split(self.generate), "-o", data]
        for group in self.train:
            for seed in self.seeds:
                for recipe in group.recipes:
                    run = str(runs / f"{Path(recipe).stem}-{seed}")
                    options = shlex.split(group.options)
                    yield ["train", recipe, *options, "--seed", str(seed), "--data", data,
                           "--resume", "-o", run]  # fmt: skip
        tables = [word for table in "123" for word in ("--paper-table", table)]
        yield ["eval", data, *shlex.split(self.eval), *tables, "--runs", str(runs), "-o", str(out)]


def load_plan(size: str) -> Plan:
    """A shipped plan by its name, or one from a TOML file. Raises ConfigError."""
    file = Path(size) if size.endswith(".toml") else _FOLDER / f"{size}.toml"
    if not file.is_file():
        known = [shipped.stem for shipped in _FOLDER.glob("*.toml")]
        raise ConfigError(f"--size {size}: no such plan ({did_you_mean(size, known)})")
    return validate(Plan, read_toml(file), str(file))


def reproduce(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for everything.")],
    size: Annotated[
        str, typer.Option(help="small (CPU), full (GPU), or a plan of your own (.toml).")
    ] = "small",
    plan: Annotated[bool, typer.Option("--plan", help="Print the commands, and run none.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Make the data, train the networks, and write the paper's tables 1 to 3 beside ours.

    Everything is in one folder: data/, runs/, paper_table_1.md to _3.md, figures/ and report.html
    with all of it. The commands that are run are printed; each could be run by hand. A training
    that is finished is kept as it is: delete its folder in runs/ to have it done again.
    """
    from glsim.cli import main

    chosen = load_plan(size)
    commands = list(chosen.commands(out))
    if plan:
        for command in commands:
            typer.echo(shlex.join(["glsim", *command]))
        return
    say(f"{chosen.title}: {len(commands)} commands")
    start = time.monotonic()
    flags = [flag for flag, on in (("-q", quiet), ("-v", verbose), ("--debug", debug)) if on]
    for number, command in enumerate(commands, 1):
        text = shlex.join(["glsim", *command])
        minutes = (time.monotonic() - start) / 60
        known = command[0] == "train" and _is_finished(Path(command[-1]))
        line = f"{number}/{len(commands)}, {minutes:.0f} min{', finished before' * known}: {text}"
        if not quiet:  # as it can be typed: on one line, and brackets are no markup
            console.print(line, markup=False, soft_wrap=True)
        if not known and main([*command, *flags]) != 0:
            raise GlsimError(f"stopped in command {number} of {len(commands)}: {text}: the same "
                             "glsim reproduce again goes on there")  # fmt: skip
    say(f"done in {(time.monotonic() - start) / 60:.0f} min: read {out / 'report.html'}")


def _is_finished(run: Path) -> bool:
    try:
        return (
            read_json(run / "run.json").get("state") == "finished" and (run / "best.pt").is_file()
        )
    except DatasetError:
        return False
