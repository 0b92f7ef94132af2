"""Recipes: what is trained, on which loss, how, and when it ends. A TOML file of differences.

    extends = "paper"                  a shipped recipe, or a file beside this one
    title = "DnCNN D7"
    row = "D7"                         the row of the paper's tables that it is, if any
    size = "small"                     full (as published), small (says what is less), own
    [model]                            see glsim.train.models.registry
    kind = "paper_input"
    backbone = { kind = "dncnn", depth = 7, width = 64 }
    [loss]                             see glsim.train.losses
    kind = "all_pixels"
    [optimiser]
    lr = 1e-4
    [training]
    patience = 10

Tables are merged over those of the recipe that is extended. A table that names another ``kind``
replaces the one below: the parameters of one kind mean nothing to another.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import cos, pi
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from glsim.errors import ConfigError, did_you_mean
from glsim.toml import assign, read_toml, split_assignment, validate

FOLDER: Final = Path(__file__).parent / "recipes"
Row = Literal["D7", "AR D7", "D20", "AR D20", "D64", "AR D64", "UNet", "Restormer"]
Metric = Literal["loss", "mse_mm2", "interior_rmse_mm", "flips"]
#: A training that is shorter than ten times its warm-up warms up in a tenth of it.
_WARM_SHARE: Final = 0.1
#: Chains of ``extends`` longer than this go in a circle.
_DEEPEST = 8


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class OptimiserSettings(_Table):
    """How weights are moved."""

    kind: Literal["adam", "adamw"] = "adam"
    lr: float = Field(1e-4, gt=0, le=1)
    weight_decay: float = Field(0.0, ge=0)
    clip_norm: float | None = Field(None, gt=0, description="largest norm of the gradient")


class ScheduleSettings(_Table):
    """How the learning rate changes: a function of the steps done, and of the share of the whole.

    The whole is what limits the training: steps, epochs or minutes, whichever ends first.
    """

    kind: Literal["constant", "cosine", "step"] = "constant"
    warmup_steps: int = Field(0, ge=0, description="from 0 to lr, linearly")
    final: float = Field(0.01, ge=0, le=1, description="share of lr at the end of cosine")
    step_at: float = Field(0.7, gt=0, le=1, description="share of the training before the step")
    step_to: float = Field(0.2, ge=0, le=1, description="share of lr after the step")

    def factor(self, steps: int, share: float) -> float:
        """What lr is multiplied with. steps: done so far. share: of the whole training, 0 to 1."""
        warm = min(1.0, max((steps + 1) / (self.warmup_steps + 1), share / _WARM_SHARE))
        if self.kind == "cosine":
            return warm * (self.final + (1 - self.final) * (1 + cos(pi * min(share, 1.0))) / 2)
        if self.kind == "step" and share >= self.step_at:
            return warm * self.step_to
        return warm


class TrainingSettings(_Table):
    """Size of the steps, when to look, when to stop, and on what."""

    batch: int = Field(4, ge=1, description="pairs a step and device")
    max_epochs: int | None = Field(None, ge=1)
    max_steps: int | None = Field(None, ge=1)
    max_minutes: float | None = Field(None, gt=0, description="of training, over all resumes")
    patience: int | None = Field(10, ge=1, description="validations without a better one")
    monitor: Metric = Field("mse_mm2", description="what is better when it is lower")
    validate_every: int = Field(1, ge=1)
    validate_unit: Literal["epochs", "steps"] = "epochs"
    ema_decay: float | None = Field(
        None, gt=0, lt=1, description="validate and keep an average of the weights over time"
    )
    precision: Literal["32-true", "bf16-mixed", "16-mixed"] = "32-true"
    compile: bool = False
    devices: int | Literal["auto"] = Field(1, description="GPUs; one CPU is always one device")


class DataSettings(_Table):
    """What is taken from a data set. What it holds is a matter of ``glsim generate``."""

    crop: int = Field(128, ge=0, description="side of the frames; 0: whole, as they are")
    cut: Literal["no", "centre", "random"] = Field("no", description="of frames that are larger")
    flip: bool = Field(False, description="mirror left and right, at random")
    relief_mm: float = Field(
        0.0, ge=0, description="height of random bumps and creases on stored pairs; 0: none"
    )
    train_frames: int | None = Field(None, ge=1, description="the first so many; all, if left out")
    validation_frames: int | None = Field(
        None, ge=1, description="spread over the split; all, if left out"
    )
    workers: int = Field(
        0, ge=0, description="processes that read or render; 0: this one, which keeps what it read"
    )
    reuse: int = Field(1, ge=1, description="uses of a pair of --simulate before it is dropped")
    epoch_steps: int = Field(500, ge=1, description="steps of --simulate that count as an epoch")


class Recipe(_Table):
    """Everything that determines a training, except the data."""

    title: str
    description: str = Field(
        "", description="one line: what it is, and what is less than published"
    )
    row: Row | None = None
    size: Literal["full", "small", "own"] = "own"
    seed: int = Field(0, ge=0, lt=2**31)
    model: dict[str, Any]
    loss: dict[str, Any]
    optimiser: OptimiserSettings = OptimiserSettings()
    schedule: ScheduleSettings = ScheduleSettings()
    training: TrainingSettings = TrainingSettings()
    data: DataSettings = DataSettings()
    simulate: dict[str, Any] = Field(
        default_factory=dict, description="settings of glsim generate, for --simulate"
    )

    def difference(self, other: Recipe) -> str | None:
        """The first setting in which the two would train differently; limits may differ."""
        ours, theirs = (_flat(recipe.model_dump(mode="json")) for recipe in (self, other))
        for name in sorted(ours.keys() | theirs.keys()):
            if name not in _LIMITS and ours.get(name) != theirs.get(name):
                return f"{name} is {ours.get(name)!r}, not {theirs.get(name)!r}"
        return None


#: What a run that is resumed may be given anew.
_LIMITS: Final = {
    "title",
    "description",
    "data.workers",
    *(f"training.{name}" for name in ("max_epochs", "max_steps", "max_minutes", "patience")),
}


def recipe_names() -> list[str]:
    """The shipped recipes. ``paper`` is not among them: it is what the paper's rows share."""
    return sorted(file.stem for file in FOLDER.glob("*.toml") if file.stem != "paper")


def load_recipe(
    recipe: str,
    assignments: Iterable[str] = (),
    overrides: Mapping[str, Any] | None = None,
) -> Recipe:
    """A recipe by name or by the path of a TOML file, then ``a.b=value``, then a nested mapping.

    Raises ConfigError: no such recipe, a file that cannot be read, an unknown key or a bad value.
    What model and loss understand is checked where they are built.
    """
    file = _find(recipe, Path())
    tree = _tree(file, 0)
    for text in assignments:
        assign(tree, *split_assignment(text, "training.batch=8 or loss.beta_mm=2"), text)
    merge_kinds(tree, overrides or {})
    return validate(Recipe, tree, str(file.stem if file.parent == FOLDER else file))


def merge_kinds(tree: dict[str, Any], over: Mapping[str, Any]) -> None:
    """Put ``over`` over nested dicts, in place; a table that names another kind replaces."""
    for key, value in over.items():
        below = tree.get(key)
        if not isinstance(value, Mapping):
            tree[key] = value
        elif isinstance(below, dict) and value.get("kind", below.get("kind")) == below.get("kind"):
            merge_kinds(below, value)
        else:
            tree[key] = dict(value)


def _find(recipe: str, beside: Path) -> Path:
    if recipe.endswith(".toml"):
        return beside / recipe
    file = FOLDER / f"{recipe}.toml"
    if not file.is_file():
        raise ConfigError(
            f"no such recipe {recipe!r} ({did_you_mean(recipe, recipe_names())}; glsim train "
            "--list shows them; the path of a recipe of your own ends in .toml)"
        )
    return file


def _tree(file: Path, depth: int) -> dict[str, Any]:
    tree = read_toml(file)
    base = tree.pop("extends", None)
    if base is None:
        return tree
    if not isinstance(base, str):
        raise ConfigError(f"{file}: extends must be the name or the path of a recipe")
    if depth == _DEEPEST:
        raise ConfigError(f"{file}: extends {base!r}, which goes in a circle")
    merged = _tree(_find(base, file.parent), depth + 1)
    merge_kinds(merged, tree)
    return merged


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        name = f"{prefix}{key}"
        flat |= _flat(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return flat
