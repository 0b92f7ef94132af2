"""``glsim paper reproduce``: reproduce the paper's tables by a series of other commands.

A plan (glsim/cli/paper/plans/*.toml) contains their options:

    title = "..."                      description of the plan
    seeds = [0, 1, 2]                  seeds of every recipe
    faces = "--subjects 60 ..."        options of glsim generate: faces, without the paper's sets
    images = 600                       images in all, with some of the paper's sets
    generate = "--sensor ..."          further options of glsim generate
    eval = "--tune-filters"                options of glsim paper tables
    protocols = ["depth", "paper"]     depth protocols of both commands; default: depth
    figures = false                    without the paper's figures; default: with them
    [[train]]                          groups in order; within a group all recipes are trained
    recipes = ["paper-d7-small"]       with the first seed, then all with the second, ...
    options = "--steps 300"            options of glsim train
    seeds = [0]                        seeds of this group, if not those of the plan, ...
    protocols = ["depth"]              and its protocols
    [filters]                          table 1 on further sets, one per seed and clean mask,
    seeds = [1, 2, 3]                  under each protocol
    generate = "--subjects 20 ..."     options of glsim generate
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
from pydantic import Field

from glsim.cli.common import console, options, print_message, run_command_line
from glsim.depth_protocol import DepthProtocol, check_protocol
from glsim.errors import ConfigError, DatasetError, GlsimError, did_you_mean
from glsim.plan.paper_sources import PAPER_SOURCES, paper_mixture, set_text
from glsim.settings.tables import TomlTable, parse_table, read_toml

EXAMPLES = """
[bold]Examples[/bold]

glsim paper reproduce -o reproduced               small: 45 minutes on two cores

glsim paper reproduce -o paper --size full        the paper's size, for a GPU

glsim paper reproduce -o mine --size mine.toml    your own plan, in the format of the shipped ones

glsim paper reproduce -o reproduced --plan        print the commands without running them

glsim paper reproduce -o paper --d3dfacs d3dfacs_alignments --biwi hpdb     with the paper's faces

Repeat the same command to resume an interrupted one.
"""

_FOLDER = Path(__file__).parent / "plans"


class TrainingGroup(TomlTable):
    """Recipes with the same options of glsim train."""

    recipes: tuple[str, ...] = Field(min_length=1)
    options: str = ""
    seeds: tuple[int, ...] = ()
    protocols: tuple[DepthProtocol, ...] = ()


class FilterSets(TomlTable):
    """Data sets for table 1 alone: nothing is trained on them."""

    seeds: tuple[int, ...] = Field((1,), min_length=1)
    generate: str


class PhotographGroup(TrainingGroup):
    """Recipes that are trained on photographs too, with each noise in grey levels of 255."""

    sigmas: tuple[float, ...] = Field((25.0,), min_length=1)


class ReproductionPlan(TomlTable):
    """Options of the commands; the module's docstring describes the keys."""

    title: str
    seeds: tuple[int, ...] = Field((0,), min_length=1)
    faces: str = ""
    images: int | None = Field(None, ge=len(PAPER_SOURCES))
    generate: str
    eval: str = ""
    protocols: tuple[DepthProtocol, ...] = Field(("depth",), min_length=1)
    figures: bool = True
    train: tuple[TrainingGroup, ...] = Field(min_length=1)
    filters: FilterSets | None = None
    photographs: PhotographGroup | None = None

    def commands(
        self, out: Path, roots: Mapping[str, Path] | None = None, photos: str | None = None
    ) -> Iterator[list[str]]:
        """Yield the arguments of each ``glsim`` command in order.

        Args:
            roots: kind of the source -> folder, of the paper's face sets that are there.
            photos: folder of photographs; default: those of scikit-image.

        Raises:
            ConfigError: a folder has no such set.
        """
        from glsim.eval.paper.protocol_page import protocol_folder
        from glsim.train.data.photograph_files import BUNDLED  # loads OpenCV

        data = str(out / "data")
        faces = self._mixture(roots) if roots else shlex.split(self.faces)
        yield ["generate", *faces, *shlex.split(self.generate), "-o", data]
        if self.filters is not None:
            yield from self._filter_commands(self.filters, out)
        for protocol in self.protocols:
            yield from self._network_commands(protocol, data, protocol_folder(out, protocol))
        if self.photographs is not None:
            yield from self._photograph_commands(self.photographs, data, out, photos or BUNDLED)
        if self.figures:
            yield ["paper", "figures", str(out)]
        if self.filters is not None:
            yield ["paper", "findings", str(out)]

    def _network_commands(
        self, protocol: DepthProtocol, data: str, out: Path
    ) -> Iterator[list[str]]:
        """Yield the trainings and the scoring of a protocol."""
        for group in self.train:
            if protocol in (group.protocols or self.protocols):
                yield from self._trainings(group, data, out / "runs", ["--protocol", protocol])
        tables = [word for table in "123" for word in ("--table", table)]
        yield ["paper", "tables", data, *shlex.split(self.eval), *tables, "--protocol", protocol,
               "--runs", str(out / "runs"), "-o", str(out)]  # fmt: skip

    def _filter_commands(self, sets: FilterSets, out: Path) -> Iterator[list[str]]:
        """Yield the commands of table 1 under each protocol and mask, and of its SSIM."""
        from glsim.eval.paper.protocol_page import FILTERS_FOLDER, MASKS

        for mask in MASKS:
            for seed in sets.seeds:
                folder = out / FILTERS_FOLDER / mask / str(seed)
                data = str(folder / "data")
                yield ["generate", *shlex.split(sets.generate), "--seed", str(seed),
                       "--set", f"output.clean_mask={mask}", "-o", data]  # fmt: skip
                for protocol in self.protocols:
                    yield ["paper", "tables", data, "--no-figures", "--no-baselines",
                           "--protocol", protocol, "-o", str(folder / protocol)]  # fmt: skip
            first = out / FILTERS_FOLDER / mask / str(sets.seeds[0])
            yield ["paper", "ssim", str(first / "data"), "-o", str(first)]
        yield ["paper", "protocols", str(out)]

    def _photograph_commands(
        self, group: PhotographGroup, data: str, out: Path, photos: str
    ) -> Iterator[list[str]]:
        """Yield the trainings on photographs, and the scoring beside those on depth."""
        photo_runs = out / "photo_runs"
        for sigma in group.sigmas:
            further = ["--protocol", "depth", "--photos", photos, "--photo-sigma", f"{sigma:g}"]
            yield from self._trainings(group, data, photo_runs / f"sigma-{sigma:g}", further)
        yield ["paper", "photographs", data, "--runs", str(out / "runs"),
               "--photo-runs", str(photo_runs), "-o", str(out)]  # fmt: skip

    def _trainings(
        self, group: TrainingGroup, data: str, runs: Path, further: Sequence[str] = ()
    ) -> Iterator[list[str]]:
        """Yield the trainings of a group: all recipes with the first seed, then with the next."""
        for seed in group.seeds or self.seeds:
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
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Train and score under one protocol only: depth (as measured) or paper (the "
            "nearest point of each face at 1 mm). Default: those of the plan, both."
        ),
    ] = None,
    d3dfacs: RootOption = None,
    facewarehouse: RootOption = None,
    biwi: RootOption = None,
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Folder of photographs, such as DIV2K. Default: those that scikit-image has."
        ),
    ] = None,
) -> None:
    """Generate the data, train the networks, and write the paper's tables 1 to 3 beside ours.

    One folder contains all results: data/, runs/, paper_table_1.md to _3.md, figures/,
    report.html, findings.html (what of the paper holds, what does not, and what it takes to find
    out), photographs.md (the networks of photo_runs/, trained on photographs, on depth), and the
    paper's figures in paper_figures/; protocol_paper/ holds the networks and tables under
    the paper's protocol (nearest point at 1 mm), protocols.md table 1 under both. Each command is
    printed before it runs and can also be run by hand. A finished training is not repeated: delete
    its folder in runs/ to train again.
    """
    root_command = context.find_root().command
    chosen = load_plan(size)
    given = {"d3dfacs": d3dfacs, "facewarehouse": facewarehouse, "biwi": biwi}
    roots = {kind: root for kind, root in given.items() if root is not None}
    if chosen.photographs is not None:  # a folder without images is told before hours of work
        from glsim.train.data.photograph_files import BUNDLED, find_photographs

        find_photographs(BUNDLED if photos is None else str(photos))
    if (only := check_protocol(protocol)) is not None:
        chosen = chosen.model_copy(update={"protocols": (only,)})
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
                             "the same glsim paper reproduce to go on there")  # fmt: skip
    page = out / ("report.html" if chosen.filters is None else "findings.html")
    print_message(f"done in {(time.monotonic() - start) / 60:.0f} min: read {page}")


def _is_finished(run: Path) -> bool:
    """Return whether the folder of a training is complete."""
    from glsim.files.atomic import read_json

    try:
        return (
            read_json(run / "run.json").get("state") == "finished" and (run / "best.pt").is_file()
        )
    except DatasetError:
        return False
