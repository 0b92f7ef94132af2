"""Recipes of a training (network, loss, optimiser, limits), as TOML files of differences.

A recipe holds only its differences from the recipe that it ``extends``, see docs/howto/training.md.
Tables are merged; a table with another ``kind`` replaces the extended one, because kinds have
different parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from math import cos, pi
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field

from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import ConfigError, DatasetError, did_you_mean
from glsim.core.files.atomic import read_json
from glsim.settings.toml_tables import (
    TomlTable,
    assign,
    flattened,
    parse_table,
    read_toml,
    split_assignment,
)

RECIPE_FOLDER: Final = Path(__file__).parent / "recipes"
#: File of a run's folder with every setting as used.
RECIPE_FILE: Final = "recipe.json"
PaperRow = Literal["D7", "AR D7", "D20", "AR D20", "D64", "AR D64", "UNet", "Restormer"]
Precision = Literal["auto", "32-true", "bf16-mixed", "16-mixed"]
MonitoredFigure = Literal["loss", "mse_mm2", "interior_rmse_mm", "flips"]
#: Largest share of the training that the warm-up of the learning rate takes.
_WARMUP_SHARE: Final = 0.1
#: Longest chain of ``extends``; longer ones are circular.
_MAX_EXTENDS: Final = 8


class OptimiserSettings(TomlTable):
    """Optimiser and its parameters."""

    kind: Literal["adam", "adamw"] = Field("adam", description="the optimiser")
    lr: float = Field(1e-4, gt=0, le=1, description="learning rate")
    weight_decay: float = Field(0.0, ge=0, le=1e3, description="as in adamw")
    clip_norm: float | None = Field(None, gt=0, description="largest norm of the gradient")


class ScheduleSettings(TomlTable):
    """Learning-rate schedule, a function of the steps and of the finished fraction of training.

    The training ends at the limit in steps, epochs or minutes, whichever comes first.
    """

    kind: Literal["constant", "cosine"] = Field(
        "constant", description="curve of the learning rate after the warm-up"
    )
    warmup_steps: int = Field(0, ge=0, le=10**9, description="steps from 0 to lr, linearly")
    final: float = Field(0.01, ge=0, le=1, description="factor on lr at the end of cosine")

    def factor(self, steps: int, done: float) -> float:
        """Compute the factor on lr after ``steps`` steps, at fraction ``done`` of the training."""
        warmup = min(1.0, max((steps + 1) / (self.warmup_steps + 1), done / _WARMUP_SHARE))
        if self.kind == "cosine":
            return warmup * (self.final + (1 - self.final) * (1 + cos(pi * min(done, 1.0))) / 2)
        return warmup


class TrainingSettings(TomlTable):
    """Batch size, validation interval, limits, early stopping and precision."""

    start: str | None = Field(
        None,
        description="a checkpoint, an ONNX file or a shipped network (face) whose weights the "
        "training starts from; further inputs of this network have no weight at first",
    )
    batch: int = Field(4, ge=1, le=4096, description="pairs per step")
    max_epochs: int | None = Field(None, ge=1, description="limit; default: none")
    max_steps: int | None = Field(None, ge=1, description="limit; default: none")
    max_minutes: float | None = Field(None, gt=0, description="training time, over all resumes")
    patience: int | None = Field(
        10, ge=1, description="validations without improvement before the training stops"
    )
    monitor: MonitoredFigure = Field(
        "mse_mm2", description="validation figure that chooses the best weights; lower is better"
    )
    validate_every: int = Field(1, ge=1, description="epochs or steps between validations")
    validate_unit: Literal["epochs", "steps"] = Field(
        "epochs", description="unit of validate_every"
    )
    ema_decay: float | None = Field(
        None, gt=0, lt=1, description="validate and keep an exponential average of the weights"
    )
    precision: Precision = Field(
        "32-true",
        description="number format of the training; auto: bf16-mixed where the GPU or the "
        "processor computes in bfloat16, else 32-true",
    )
    compile: bool = Field(False, description="whether torch.compile is used")


class DataSettings(TomlTable):
    """Selection and augmentation of pairs; the content is decided by ``glsim generate``."""

    crop: int = Field(
        128, ge=0, le=8192, description="side of the square frames, px; 0: whole frames"
    )
    cut: Literal["no", "centre", "random"] = Field(
        "no", description="how frames larger than crop are cropped; no: they are an error"
    )
    target: Literal["clean", "expected"] = Field(
        "clean", description="what is learnt: the true depth, or what the sensor says without noise"
    )
    protocol: DepthProtocol | None = Field(
        None,
        description="where depth is counted from: depth (as measured) or paper (the nearest point "
        "of each target at 1 mm); default: that of the data sets",
    )
    flip: bool = Field(False, description="mirror left and right, at random")
    relief_mm: float = Field(
        0.0, ge=0, le=1000, description="height of random surface bumps on stored pairs; 0: none"
    )
    slope_mm_per_px: float = Field(
        0.0, ge=0, le=100, description="largest slope of a plane added to stored pairs; 0: none"
    )
    texture: float = Field(
        0.0, ge=0, le=1, description="share of stored pairs with ribs or grain, as fabric and hair"
    )
    averaged: float = Field(
        0.0, ge=0, le=1, description="share of stored pairs with the noise of averaged frames"
    )
    photographs: str | None = Field(
        None,
        description="folder of pictures to train on instead of depth: grey values as mm, Gaussian "
        "noise of 25; the data set validates",
    )
    train_frames: int | None = Field(None, ge=1, description="use the first N frames; default: all")
    validation_frames: int | None = Field(
        None, ge=1, description="number of frames, spread evenly over the split; default: all"
    )
    workers: int = Field(
        0,
        ge=0,
        le=1024,
        description="number of processes that read or render; 0: this one, with a cache",
    )
    reuse: int = Field(1, ge=1, le=10_000, description="uses of each pair of --simulate")
    epoch_steps: int = Field(500, ge=1, le=10**8, description="steps per epoch of --simulate")


class Recipe(TomlTable):
    """Every setting of a training except its data."""

    title: str = Field(description="one line")
    description: str = Field(
        "", description="one line: the network, and how it is smaller than published"
    )
    row: PaperRow | None = Field(None, description="row of the paper's tables 2 and 3")
    size: Literal["full", "small", "own"] = Field(
        "own", description="of a row: as published, or smaller"
    )
    seed: int = Field(0, ge=0, lt=2**31, description="of weights, order and augmentation")
    model: dict[str, Any] = Field(description="kind and parameters of the network")
    loss: dict[str, Any] = Field(description="kind and parameters of the loss")
    optimiser: OptimiserSettings = OptimiserSettings()
    schedule: ScheduleSettings = ScheduleSettings()
    training: TrainingSettings = TrainingSettings()
    data: DataSettings = DataSettings()
    simulate: dict[str, Any] = Field(
        default_factory=dict, description="changes to the settings of --simulate"
    )
    assignments: tuple[str, ...] = Field(
        (), description="written by glsim train: its --set, which --resume repeats"
    )

    def difference(self, other: Recipe) -> str | None:
        """Name the first setting by which the trainings differ; None for equal trainings."""
        ours, theirs = (flattened(recipe.model_dump(mode="json")) for recipe in (self, other))
        for name in sorted(ours.keys() | theirs.keys()):
            if name not in _RESUMABLE and ours.get(name) != theirs.get(name):
                return f"{name} is {ours.get(name)!r}, not {theirs.get(name)!r}"
        return None


#: Settings that may change when a training is resumed.
_RESUMABLE: Final = {
    *("title", "description", "assignments", "data.workers"),
    "data.protocol",  # compared by the data's fingerprint instead
    *(f"training.{name}" for name in ("max_epochs", "max_steps", "max_minutes", "patience")),
}


def recipe_names() -> list[str]:
    """Return the names of shipped recipes, without ``paper``, the base of the paper's recipes."""
    return sorted(file.stem for file in RECIPE_FOLDER.glob("*.toml") if file.stem != "paper")


def load_recipe(
    recipe: str, assignments: Iterable[str] = (), overrides: Mapping[str, Any] | None = None
) -> Recipe:
    """Load a recipe by its name, or by the path of its TOML file or of a run's recipe.json.

    ``assignments`` are texts, ``table.key=value``; ``overrides``, tables, come after them. [model]
    and [loss] are checked when they are built. Raises ConfigError for an unknown recipe, an
    unreadable file, an unknown key or a bad value.
    """
    file = _recipe_file(recipe, Path())
    tree = _read_tree(file, 0)
    tree["assignments"], places = list(assignments), {}
    for text in tree["assignments"]:
        path, value = split_assignment(text, "training.batch=8 or loss.beta_mm=2")
        assign(tree, path, value, text)
        places[tuple(path)] = f"--set {text}"
    merge_kinds(tree, overrides or {})
    where = str(file.stem if file.parent == RECIPE_FOLDER else file)
    return parse_table(Recipe, tree, where, places)


def assignments_of(run: Path) -> list[str]:
    """Return the assignments with which a run's folder was begun; none without its recipe.json."""
    with suppress(DatasetError):
        return list(read_json(run / RECIPE_FILE).get("assignments", ()))
    return []


def merge_kinds(tree: dict[str, Any], over: Mapping[str, Any]) -> None:
    """Merge ``over`` into nested dicts, in place; a table with another kind is replaced."""
    for key, value in over.items():
        below = tree.get(key)
        if not isinstance(value, Mapping):
            tree[key] = value
        elif isinstance(below, dict) and value.get("kind", below.get("kind")) == below.get("kind"):
            merge_kinds(below, value)
        else:
            tree[key] = dict(value)


def _recipe_file(recipe: str, folder: Path) -> Path:
    if recipe.endswith((".toml", ".json")):
        return folder / recipe
    file = RECIPE_FOLDER / f"{recipe}.toml"
    if not file.is_file():
        raise ConfigError(
            f"no such recipe {recipe!r} ({did_you_mean(recipe, recipe_names())}; glsim train "
            "--list prints all; the path of a recipe file ends in .toml)"
        )
    return file


def _read_tree(file: Path, depth: int) -> dict[str, Any]:
    tree = read_json(file) if file.name == RECIPE_FILE else read_toml(file)
    base = tree.pop("extends", None)
    if base is None:
        return tree
    if not isinstance(base, str):
        raise ConfigError(f"{file}: extends must be the name or the path of a recipe")
    if depth == _MAX_EXTENDS:
        raise ConfigError(f"{file}: extends {base!r}, which goes in a circle")
    merged = _read_tree(_recipe_file(base, file.parent), depth + 1)
    merge_kinds(merged, tree)
    return merged
