"""Reproduction of the paper: data, networks, tables 1 to 3, figures, and the 39 printed values.

FOLDER/plan.json                     name and title of the plan
FOLDER/data, FOLDER/runs             pairs and networks with dense clean maps, measured depth
FOLDER/[mask_MASK/][protocol_paper/] pairs, networks and tables of the other three cases
FOLDER/filters/MASK/SEED             data for table 1 alone, with PROTOCOL/ for its scores
FOLDER/paper_figures, paper_values.* figures 1 to 6; each printed value beside ours
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field

from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.files.atomic import to_json, write_atomic
from glsim.eval.paper.data_note import PLAN_FILE
from glsim.eval.paper.figures.draw_figures import write_paper_figures
from glsim.eval.paper.ours_beside_printed import (
    FILTERS_FOLDER,
    case_folder,
    mask_folder,
    write_values,
)
from glsim.eval.paper.plan_hours import plan_hours
from glsim.eval.paper.runner import Runner
from glsim.eval.paper.score_tables import score_tables
from glsim.eval.report.document import TextTable
from glsim.eval.scoring.blocks import ScoringJob
from glsim.settings.schema import Settings, load_settings
from glsim.settings.toml_tables import TomlTable, merge_tables, parse_table, read_toml
from glsim.simulation.plan.paper_sources import PAPER_SOURCES, paper_mixture
from glsim.train.recipe import Recipe, load_recipe

_FOLDER: Final = Path(__file__).parent / "plans"
#: ``output.clean_mask`` of the data.
CleanMask = Literal["dense", "as-noisy"]


class TrainingGroup(TomlTable):
    """Recipes with common limits; all of them are trained with one seed, then with the next."""

    recipes: tuple[str, ...] = Field(min_length=1)
    steps: int | None = Field(None, ge=1, description="default: as in the recipe")
    set: tuple[str, ...] = Field((), description="changes to the recipe, as glsim train --set")
    seeds: tuple[int, ...] = Field((), description="default: those of the plan")
    masks: tuple[CleanMask, ...] = Field((), description="default: those of the plan")


class FilterSets(TomlTable):
    """Settings of the data sets that only table 1 uses: one data set for each seed and mask."""

    seeds: tuple[int, ...] = Field((1,), min_length=1)
    subjects: int = Field(ge=1)
    frames_per_subject: int = Field(ge=1)


class ReproductionPlan(TomlTable):
    """Plan of what a reproduction generates, trains and scores, read from eval/paper/plans/."""

    title: str
    size: str = Field("", description="name in titles; default: that of the plan's file")
    protocols: tuple[DepthProtocol, ...] = Field(("depth",), min_length=1)
    masks: tuple[CleanMask, ...] = Field(("dense",), min_length=1)
    seeds: tuple[int, ...] = Field((0,), min_length=1)
    subjects: int = Field(ge=1, description="embedded heads, without the paper's face sets")
    frames_per_subject: int = Field(ge=1)
    images: int | None = Field(None, ge=len(PAPER_SOURCES), description="in all, with face sets")
    denoisers: tuple[str, ...] = Field((), description="scored beside the paper's filters")
    settings: dict[str, Any] = Field(default_factory=dict, description="as for glsim generate")
    report: bool = Field(True, description="draw report.html and the paper's figures")
    train: tuple[TrainingGroup, ...] = Field(min_length=1)
    filters: FilterSets | None = None

    def data_settings(self, mask: str, roots: Mapping[str, Path]) -> Settings:
        """Return the settings of the data set of the networks. Raises ConfigError.

        ``mask``: key of MASKS; ``roots``: kind of source -> folder of each present face set.
        """
        if not roots:
            return self.settings_of(mask, self.subjects, self.frames_per_subject)
        if self.images is None:
            raise ConfigError(f"{self.title}: a plan with face sets needs images = N")
        return self.settings_of(mask, 0, 0, source=paper_mixture(roots, self.images))

    def settings_of(self, mask: str, subjects: int, frames: int, **more: Any) -> Settings:
        """Return the settings of a data set of embedded heads, or of ``source`` in ``more``."""
        heads = {"kind": "procedural", "subjects": subjects, "frames_per_subject": frames}
        tree: dict[str, Any] = copy.deepcopy(self.settings)
        merge_tables(tree, {"output": {"clean_mask": mask}} | more)
        return load_settings(overrides=tree, source=None if "source" in more else heads)

    def trainings(self, protocol: DepthProtocol, mask: str) -> dict[str, Recipe]:
        """Return run name -> recipe of the networks of a case, in order. Raises ConfigError."""
        return {
            f"{Path(name).stem}-{seed}": load_recipe(
                name,
                group.set,
                {"seed": seed, "data": {"protocol": protocol}}
                | ({"training": {"max_steps": group.steps}} if group.steps else {}),
            )
            for group in self.train
            if mask in (group.masks or self.masks)
            for seed in group.seeds or self.seeds
            for name in group.recipes
        }

    def hours(self) -> TextTable:
        """Return the hours of all trainings at most: on this machine, and on GPUs."""
        cases = [(protocol, mask) for mask in self.masks for protocol in self.protocols]
        recipes = [recipe for case in cases for recipe in self.trainings(*case).values()]
        images = self.images or self.subjects * self.frames_per_subject
        return plan_hours(recipes, self.data_settings("dense", {}).split, images)


def load_plan(size: str) -> ReproductionPlan:
    """Load a shipped plan by its name, or a plan from a TOML file. Raises ConfigError."""
    file = Path(size) if size.endswith(".toml") else _FOLDER / f"{size}.toml"
    if not file.is_file():
        known = [shipped.stem for shipped in _FOLDER.glob("*.toml")]
        raise ConfigError(f"--size {size}: no such plan ({did_you_mean(size, known)})")
    return parse_table(ReproductionPlan, {"size": file.stem} | read_toml(file), str(file))


def reproduce(
    plan: ReproductionPlan, runner: Runner, roots: Mapping[str, Path] | None = None
) -> list[Path]:
    """Run all steps of a plan (generate, train, score); steps that are complete are skipped.

    ``roots``: kind of face source -> folder, for each face set of the paper that the user has.

    Returns the written files, which show printed values beside ours. Raises GlsimError that names
    a failed step, KeyboardInterrupt if a signal stopped a training.
    """
    out = runner.out
    cases = [(protocol, mask) for mask in plan.masks for protocol in plan.protocols]
    trainings = {case: plan.trainings(*case) for case in cases}  # reports wrong recipes early
    if not runner.dry:
        write_atomic(
            to_json({"size": plan.size, "title": plan.title}, "plan").encode(), out / PLAN_FILE
        )
    for mask in plan.masks:
        runner.generate(plan.data_settings(mask, roots or {}), mask_folder(out, mask) / "data")
    if plan.filters is not None:
        for mask, seed in product(plan.masks, plan.filters.seeds):
            folder = out / FILTERS_FOLDER / mask / str(seed)
            counts = plan.filters.subjects, plan.filters.frames_per_subject
            heads = plan.settings_of(mask, *counts, seed=seed, split=[0, 0, 1])
            runner.generate(heads, folder / "data")
            for protocol in plan.protocols:
                _score(plan, runner, folder / "data", folder / protocol, protocol, (1,))
    for (protocol, mask), recipes in trainings.items():
        data, folder = mask_folder(out, mask) / "data", case_folder(out, protocol, mask)
        for name, recipe in recipes.items():
            runner.train(recipe, [data], folder / "runs" / name)
        _score(plan, runner, data, folder, protocol, (1, 2, 3, 4))
    if plan.report:
        inputs = sorted(str(path.stat().st_mtime_ns) for path in out.rglob("runs/*/best.pt"))
        runner.step("draw figures", lambda: write_paper_figures(out), inputs, out / "paper_figures")
    return runner.step("compare the printed values", lambda: write_values(out)) or []


def _score(
    plan: ReproductionPlan, runner: Runner, data: Path, folder: Path, protocol: DepthProtocol,
    tables: Sequence[int],
) -> None:  # fmt: skip
    runs = folder / "runs" if 2 in tables else None
    job = ScoringJob(data, "test", plan.denoisers if runs else (), protocol=protocol)

    def run() -> None:
        with runner.displays.frames("scoring") as progress:
            score_tables(
                job, folder, tables, runs, size=f", {plan.size}",
                figures=plan.report and runs is not None, workers=runner.workers, progress=progress,
            )  # fmt: skip

    names = " ".join(map(str, tables))
    runner.step(f"tables {names} in {folder.relative_to(runner.out).as_posix()}", run)
