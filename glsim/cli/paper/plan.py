"""Plans of ``glsim paper reproduce``: which commands it runs, in a TOML file.

A plan (glsim/cli/paper/plans/*.toml) contains the options of the commands:

    title = "..."                      description of the plan
    seeds = [0, 1, 2]                  seeds of every recipe
    faces = "--subjects 60 ..."        options of glsim generate: faces, without the paper's sets
    images = 600                       images in all, with some of the paper's sets
    generate = "--sensor ..."          further options of glsim generate
    eval = "--tune-filters"                options of glsim paper tables
    protocols = ["depth", "paper"]     depth protocols of both commands; default: depth
    masks = ["dense", "as-noisy"]      output.clean_mask of the networks' data; default: dense
    figures = false                    without the paper's figures; default: with them
    [[train]]                          groups in order; within a group all recipes are trained
    recipes = ["paper-d7-small"]       with the first seed, then all with the second, ...
    options = "--steps 300"            options of glsim train
    seeds = [0]                        seeds of this group, if not those of the plan, ...
    protocols = ["depth"]              its protocols,
    masks = ["dense"]                  and its masks
    [filters]                          table 1 on further sets, one per seed and clean mask,
    seeds = [1, 2, 3]                  under each protocol
    generate = "--subjects 20 ..."     options of glsim generate
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from glsim.depth_protocol import DepthProtocol
from glsim.errors import ConfigError, did_you_mean
from glsim.plan.paper_sources import PAPER_SOURCES, paper_mixture, set_text
from glsim.plan.paper_split import PAPER_IMAGES
from glsim.settings.tables import TomlTable, parse_table, read_toml

_FOLDER = Path(__file__).parent / "plans"
#: ``output.clean_mask`` of the data.
CleanMask = Literal["dense", "as-noisy"]


class TrainingGroup(TomlTable):
    """Recipes with the same options of glsim train."""

    recipes: tuple[str, ...] = Field(min_length=1)
    options: str = ""
    seeds: tuple[int, ...] = ()
    protocols: tuple[DepthProtocol, ...] = ()
    masks: tuple[CleanMask, ...] = ()


class FilterSets(TomlTable):
    """Data sets for table 1 alone: nothing is trained on them."""

    seeds: tuple[int, ...] = Field((1,), min_length=1)
    generate: str


class ReproductionPlan(TomlTable):
    """Options of the commands; the module's docstring describes the keys."""

    title: str
    seeds: tuple[int, ...] = Field((0,), min_length=1)
    faces: str = ""
    images: int | None = Field(None, ge=len(PAPER_SOURCES))
    generate: str
    eval: str = ""
    protocols: tuple[DepthProtocol, ...] = Field(("depth",), min_length=1)
    masks: tuple[CleanMask, ...] = Field(("dense",), min_length=1)
    figures: bool = True
    train: tuple[TrainingGroup, ...] = Field(min_length=1)
    filters: FilterSets | None = None

    def commands(self, out: Path, roots: Mapping[str, Path] | None = None) -> Iterator[list[str]]:
        """Yield the arguments of each ``glsim`` command in order.

        Args:
            out: folder of the reproduction.
            roots: kind of source -> folder, for the available face sets of the paper.

        Raises:
            ConfigError: for a folder without such a set.
        """
        from glsim.eval.paper.cases import mask_folder

        faces = self._mixture(roots) if roots else shlex.split(self.faces)
        for mask in self.masks:
            yield ["generate", *faces, *shlex.split(self.generate),
                   *(() if mask == "dense" else ("--set", f"output.clean_mask={mask}")),
                   "-o", str(mask_folder(out, mask) / "data")]  # fmt: skip
        if self.filters is not None:
            yield from self._filter_commands(self.filters, out)
        for mask in self.masks:
            for protocol in self.protocols:
                yield from self._network_commands(protocol, mask, out)
        if self.figures:
            yield ["paper", "figures", str(out)]
        yield ["paper", "page", str(out)]

    def _network_commands(
        self, protocol: DepthProtocol, mask: CleanMask, out: Path
    ) -> Iterator[list[str]]:
        """Yield the trainings and the scoring of a case, if anything is trained under it."""
        from glsim.eval.paper.cases import case_folder, mask_folder

        groups = [
            group
            for group in self.train
            if protocol in (group.protocols or self.protocols)
            and mask in (group.masks or self.masks)
        ]
        if not groups:
            return
        data, out = str(mask_folder(out, mask) / "data"), case_folder(out, protocol, mask)
        for group in groups:
            yield from self._trainings(group, data, out / "runs", ["--protocol", protocol])
        tables = [word for table in "123" for word in ("--table", table)]
        yield ["paper", "tables", data, *shlex.split(self.eval), *tables, "--protocol", protocol,
               "--runs", str(out / "runs"), "-o", str(out)]  # fmt: skip

    def _filter_commands(self, sets: FilterSets, out: Path) -> Iterator[list[str]]:
        """Yield the commands of table 1 under each protocol and mask, and of its SSIM."""
        from glsim.eval.paper.cases import FILTERS_FOLDER, MASKS

        for mask in MASKS:
            for seed in sets.seeds:
                folder = out / FILTERS_FOLDER / mask / str(seed)
                data = str(folder / "data")
                yield ["generate", *shlex.split(sets.generate), "--seed", str(seed),
                       "--set", f"output.clean_mask={mask}", "-o", data]  # fmt: skip
                yield from self._filter_tables(folder)

    def _filter_tables(self, folder: Path, *further: str) -> Iterator[list[str]]:
        """Yield the commands that score FOLDER/data by the filters under each protocol."""
        for protocol in self.protocols:
            yield ["paper", "tables", str(folder / "data"), "--no-figures", *further,
                   "--protocol", protocol, "-o", str(folder / protocol)]  # fmt: skip

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

    def training_images(self) -> int | None:
        """Return the number of images to train on, by the paper's split; None if unknown."""
        return self.images and round(self.images * PAPER_IMAGES[0] / sum(PAPER_IMAGES))

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
