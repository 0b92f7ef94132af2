"""``glsim reproduce``: reproduce the paper's tables by a series of other commands.

A plan (glsim/cli/reproductions/*.toml) contains their options:

    title = "..."                      description of the plan
    seeds = [0, 1, 2]                  seeds of every recipe
    faces = "--subjects 60 ..."        options of glsim generate: faces, without the paper's sets
    images = 600                       images in all, with some of the paper's sets
    generate = "--sensor ..."          further options of glsim generate
    eval = "--tune"                    options of glsim eval
    figures = false                    without the paper's figures; default: with them
    [[train]]                          groups in order; within a group all recipes are trained
    recipes = ["paper-d7-small"]       with the first seed, then all with the second, ...
    options = "--steps 300"            options of glsim train
    [photographs]                      recipes that are trained on photographs too
    recipes = ["paper-d7-small"]       each with all seeds and noises, like in [[train]]
    sigmas = [25, 10]                  noise, grey levels of 255

Each command resumes its own work; this module only skips trainings that are finished.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel, ConfigDict, Field

from glsim.cli.common import console, options, print_message, print_written, run_command_line
from glsim.errors import ConfigError, DatasetError, GlsimError, did_you_mean
from glsim.plan.paper_sources import PAPER_SOURCES, paper_mixture, set_text
from glsim.settings.tables import parse_table, read_toml

EXAMPLES = """
[bold]Examples[/bold]

glsim reproduce -o reproduced               small: half an hour on two cores

glsim reproduce -o paper --size full        the paper's size, for a GPU

glsim reproduce -o mine --size mine.toml    your own plan, in the format of the shipped ones

glsim reproduce -o reproduced --plan        print the commands without running them

glsim reproduce -o paper --d3dfacs d3dfacs_alignments --biwi hpdb     with the paper's faces

glsim reproduce -o reproduced --figures     draw the paper's figures 1 to 5 from that folder

Repeat the same command to resume an interrupted one.
"""

_FOLDER = Path(__file__).parent / "reproductions"


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TrainingGroup(_Table):
    """Recipes with the same options of glsim train."""

    recipes: tuple[str, ...] = Field(min_length=1)
    options: str = ""


class PhotographGroup(TrainingGroup):
    """Recipes that are trained on photographs too, with each noise in grey levels of 255."""

    sigmas: tuple[float, ...] = Field((25.0,), min_length=1)


class ReproductionPlan(_Table):
    """Options of the commands; the module's docstring describes the keys."""

    title: str
    seeds: tuple[int, ...] = Field((0,), min_length=1)
    faces: str = ""
    images: int | None = Field(None, ge=len(PAPER_SOURCES))
    generate: str
    eval: str = ""
    figures: bool = True
    train: tuple[TrainingGroup, ...] = Field(min_length=1)

    photographs: PhotographGroup | None = None

    def commands(
        self, out: Path, roots: Mapping[str, Path] | None = None, photos: str | None = None
    ) -> Iterator[list[str]]:
        """Yield the arguments of each ``glsim`` command in order.

        roots: kind of the source -> folder, of the paper's face sets that are there. photos: a
        folder of photographs; default: those of scikit-image. Raises ConfigError for a folder
        without such a set.
        """
        from glsim.train.data.photograph_files import BUNDLED  # loads OpenCV

        data, runs = str(out / "data"), out / "runs"
        faces = self._mixture(roots) if roots else shlex.split(self.faces)
        yield ["generate", *faces, *shlex.split(self.generate), "-o", data]
        for group in self.train:
            yield from self._trainings(group, data, runs)
        tables = [word for table in "123" for word in ("--paper-table", table)]
        yield ["eval", data, *shlex.split(self.eval), *tables, "--runs", str(runs), "-o", str(out)]
        if self.photographs is not None:
            photo_runs = out / "photo_runs"
            for sigma in self.photographs.sigmas:
                noise = ["--photos", photos or BUNDLED, "--photo-sigma", f"{sigma:g}"]
                folder = photo_runs / f"sigma-{sigma:g}"
                yield from self._trainings(self.photographs, data, folder, noise)
            yield ["eval", data, "--runs", str(runs), "--photo-runs", str(photo_runs),
                   "-o", str(out)]  # fmt: skip
        if self.figures:
            yield ["reproduce", "-o", str(out), "--figures"]

    def _trainings(
        self, group: TrainingGroup, data: str, runs: Path, further: Sequence[str] = ()
    ) -> Iterator[list[str]]:
        """Yield the trainings of a group: all recipes with the first seed, then with the next."""
        for seed in self.seeds:
            for recipe in group.recipes:
                run = str(runs / f"{Path(recipe).stem}-{seed}")
                options = [*shlex.split(group.options), *further]
                yield ["train", recipe, *options, "--seed", str(seed), "--data", data,
                       "--resume", "-o", run]  # fmt: skip

    def _mixture(self, roots: Mapping[str, Path]) -> list[str]:
        if self.images is None:
            raise ConfigError(f"{self.title}: a plan with face sets needs images = N")
        return ["--set", set_text(paper_mixture(roots, self.images))]


def load_plan(size: str) -> ReproductionPlan:
    """Load a shipped plan by its name, or a plan from a TOML file. Raises ConfigError."""
    file = Path(size) if size.endswith(".toml") else _FOLDER / f"{size}.toml"
    if not file.is_file():
        known = [shipped.stem for shipped in _FOLDER.glob("*.toml")]
        raise ConfigError(f"--size {size}: no such plan ({did_you_mean(size, known)})")
    return parse_table(ReproductionPlan, read_toml(file), str(file))


RootOption = Annotated[
    Path | None,
    typer.Option(help="Folder of this face set of the paper. Without it: embedded heads."),
]


def reproduce(
    context: typer.Context,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for all results.")],
    size: Annotated[
        str, typer.Option(help="Plan: small (CPU), full (GPU), or your own .toml file.")
    ] = "small",
    plan: Annotated[
        bool, typer.Option("--plan", help="Print the commands without running them.")
    ] = False,
    d3dfacs: RootOption = None,
    facewarehouse: RootOption = None,
    biwi: RootOption = None,
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Folder of photographs, such as DIV2K. Default: those that scikit-image has."
        ),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option(
            "--figures", help="Only draw the paper's figures, from the data and networks in -o."
        ),
    ] = False,
) -> None:
    """Generate the data, train the networks, and write the paper's tables 1 to 3 beside ours.

    One folder contains all results: data/, runs/, paper_table_1.md to _3.md, figures/,
    report.html, photographs.md (the networks of photo_runs/, trained on photographs, on depth),
    and the paper's figures in paper_figures/. Each command is printed before it runs
    and can also be run by hand. A finished training is not repeated: delete its folder in runs/ to
    train again.
    """
    if figures:
        from glsim.eval.paper.figures.write import write_paper_figures

        print_written(write_paper_figures(out, lambda name: print_message(f"drawing {name}")))
        return
    root_command = context.find_root().command
    chosen = load_plan(size)
    given = {"d3dfacs": d3dfacs, "facewarehouse": facewarehouse, "biwi": biwi}
    roots = {kind: root for kind, root in given.items() if root is not None}
    if chosen.photographs is not None:  # a folder without images is told before hours of work
        from glsim.train.data.photograph_files import BUNDLED, find_photographs

        find_photographs(BUNDLED if photos is None else str(photos))
    commands = list(chosen.commands(out, roots, None if photos is None else str(photos)))
    flags = options.flags
    if plan:
        for command in commands:
            typer.echo(shlex.join(["glsim", *command]))
        return
    print_message(f"{chosen.title}: {len(commands)} commands")
    start = time.monotonic()
    for number, command in enumerate(commands, 1):
        text = shlex.join(["glsim", *command])
        minutes = (time.monotonic() - start) / 60
        finished = command[0] == "train" and _is_finished(Path(command[-1]))
        state = ", finished before" if finished else ""
        line = f"{number}/{len(commands)}, {minutes:.0f} min{state}: {text}"
        if not options.quiet:  # on one line and without markup, so that it can be copied
            console.print(line, soft_wrap=True)
        if not finished and run_command_line(root_command, [*command, *flags]) != 0:
            raise GlsimError(f"stopped in command {number} of {len(commands)}: {text}: repeat "
                             "the same glsim reproduce to go on there")  # fmt: skip
    print_message(f"done in {(time.monotonic() - start) / 60:.0f} min: read {out / 'report.html'}")


def _is_finished(run: Path) -> bool:
    """Return whether the folder of a training is complete."""
    from glsim.files.atomic import read_json

    try:
        return (
            read_json(run / "run.json").get("state") == "finished" and (run / "best.pt").is_file()
        )
    except DatasetError:
        return False
