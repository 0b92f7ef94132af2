"""Search for the trained networks in FOLDER/*/, with their recipes and results.

It reads JSON, and opens each checkpoint once, to report damaged files before scoring starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ValidationError

from glsim.core.errors import ConfigError, DatasetError, DenoiserError
from glsim.core.files.atomic import read_json
from glsim.denoise.registry import denoiser_names, load_denoiser


class TrainedRun(BaseModel):
    """A run of ``glsim train`` as described by its recipe.json and run.json.

    ``row`` of the paper's tables: None for another network. ``description``: differences from the
    published training. ``ended``: the limit that ended it; None before the end.
    """

    checkpoint: Path
    title: str
    row: str | None = None
    size: str
    description: str
    seed: int
    seconds: float
    steps: int
    state: str
    ended: str | None = None

    @property
    def is_trained(self) -> bool:
        """Whether the validation stopped improving; otherwise another limit ended the training."""
        return self.ended == "patience"

    @property
    def label(self) -> str:
        """Name in tables: that of the run's folder; runs/face if a shipped denoiser has it."""
        *_, above, name = self.checkpoint.absolute().parent.parts
        label = f"{above}/{name}" if name in denoiser_names() else name
        return label.replace("@", "-")

    @property
    def network(self) -> tuple[str, str | None, str]:
        """Title, row and size; trainings with other seeds have the same."""
        return self.title, self.row, self.size

    @property
    def spec(self) -> str:
        """Specification of the denoiser for ``glsim.load_denoiser``."""
        return f"{self.label}@{self.checkpoint}"


class TrainedNetworks(NamedTuple):
    """The trained networks of a folder, by name; ``refused``: why checkpoints were left out."""

    folder: Path
    runs: list[TrainedRun]
    refused: list[str]


def find_trained_runs(folder: Path) -> TrainedNetworks:
    """Find the trained networks of a folder. Raises ConfigError if it has no checkpoint."""
    if not folder.is_dir():
        raise ConfigError(f"--runs {folder}: no such folder")
    runs: list[TrainedRun] = []
    refused: list[str] = []
    checkpoints = sorted(folder.glob("*/best.pt"))
    if not checkpoints:
        raise ConfigError(
            f"--runs {folder}: no */best.pt: train with glsim train RECIPE -o {folder}/NAME"
        )
    seen: dict[tuple[str, str | None, str, int], Path] = {}
    for checkpoint in checkpoints:
        try:
            run = _read(checkpoint)
            load_denoiser(run.spec)
        except (DatasetError, DenoiserError) as error:
            refused.append(str(error))
            continue
        first = seen.setdefault((*run.network, run.seed), checkpoint)
        if first == checkpoint:
            runs.append(run)
        else:  # a repeated seed would make the spread over seeds too small
            refused.append(
                f"{checkpoint}: is the same recipe and seed as {first}: if it is another network, "
                "train it with glsim train --set title=..."
            )
    return TrainedNetworks(folder, runs, refused)


def _read(checkpoint: Path) -> TrainedRun:
    folder = checkpoint.parent
    fields = read_json(folder / "recipe.json") | read_json(folder / "run.json")
    try:
        return TrainedRun.model_validate({"checkpoint": checkpoint} | fields)
    except ValidationError as error:
        raise DatasetError(
            f"{folder}: recipe.json or run.json is of no run of glsim train: "
            f"{error.errors()[0]['loc']}: {error.errors()[0]['msg']}"
        ) from None


class SeedGroup(NamedTuple):
    """The trainings of a network at one size, by their seeds: a row of a table."""

    title: str
    row: str | None
    size: str
    members: list[TrainedRun]

    @property
    def training(self) -> str:
        """Size, seeds, steps and time of the trainings, for tables."""
        minutes = sum(run.seconds for run in self.members) / 60 / len(self.members)
        falling = "" if all(run.is_trained for run in self.members) else ", still falling"
        steps = steps_text(self.members)
        return f"{self.size}, seeds: {len(self.members)}, {steps}, {minutes:.1f} min each{falling}"


def steps_text(runs: Sequence[TrainedRun]) -> str:
    """Return the smallest and the largest number of steps of some trainings as text."""
    low, high = min(run.steps for run in runs), max(run.steps for run in runs)
    return f"{low:,} steps" if low == high else f"{low:,} to {high:,} steps"


def group_by_network(trained: Sequence[TrainedRun]) -> list[SeedGroup]:
    """Group trainings of the same title, row and size, which differ in the seed only."""
    groups: dict[tuple[str, str | None, str], SeedGroup] = {}
    for run in sorted(trained, key=lambda run: run.seed):
        groups.setdefault(run.network, SeedGroup(*run.network, [])).members.append(run)
    return list(groups.values())
