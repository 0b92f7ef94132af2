"""Trained networks in a folder: what ``glsim train`` left in FOLDER/*/ and how it came about.

Only JSON is read here; checkpoints are opened as any denoiser is (``denoisers.load``), once, so
that one which is truncated or of another origin is named before the scoring starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from glsim.dataset.files import read_json
from glsim.errors import ConfigError, DatasetError, DenoiserError

from .denoisers import load


@dataclass(frozen=True)
class Trained:
    """One training. label: its name in tables, that of its folder.

    row: of the paper's tables, None for another network. size: full, small or own.
    description: what is less than published. minutes: of training. parameters: of the network.
    finished: False if the training was interrupted, and the checkpoint is the best until then.
    """

    checkpoint: Path
    title: str
    row: str | None
    size: str
    description: str
    seed: int
    minutes: float
    steps: int
    parameters: int
    finished: bool

    @property
    def label(self) -> str:
        """Unique in a folder of runs."""
        return self.checkpoint.parent.name.replace("@", "-")

    @property
    def network(self) -> tuple[str, str | None, str]:
        """What its seeds share: title, row and size."""
        return self.title, self.row, self.size

    @property
    def spec(self) -> str:
        """As it is given to ``denoisers.load``."""
        return f"{self.label}@{self.checkpoint}"


def find_trained(folder: Path) -> tuple[list[Trained], list[str]]:
    """The networks below ``folder`` in the order of names, and why others are left out.

    Raises ConfigError if there is no such folder, or no checkpoint in it.
    """
    if not folder.is_dir():
        raise ConfigError(f"--runs {folder}: no such folder")
    found: list[Trained] = []
    refused: list[str] = []
    checkpoints = sorted(folder.glob("*/best.pt"))
    if not checkpoints:
        raise ConfigError(
            f"--runs {folder}: no */best.pt: train with glsim train RECIPE -o {folder}/NAME"
        )
    seen: dict[tuple[str, str | None, str, int], Path] = {}
    for checkpoint in checkpoints:
        try:
            trained = _read(checkpoint)
            load(trained.spec)
        except (DatasetError, DenoiserError) as error:
            refused.append(str(error))
            continue
        first = seen.setdefault((*trained.network, trained.seed), checkpoint)
        if first == checkpoint:
            found.append(trained)
        else:  # the spread over seeds would be of fewer than it says
            refused.append(
                f"{checkpoint}: is the same recipe and seed as {first}: if it is another network, "
                "train it under a title of its own (--set title=...)"
            )
    return found, refused


def _read(checkpoint: Path) -> Trained:
    folder = checkpoint.parent
    recipe = read_json(folder / "recipe.json")
    run = read_json(folder / "run.json")
    try:
        return Trained(
            checkpoint,
            str(recipe["title"]),
            recipe.get("row"),
            str(recipe["size"]),
            str(recipe["description"]),
            int(recipe["seed"]),
            float(run["seconds"]) / 60,
            int(run["steps"]),
            int(run["parameters"]),
            run["state"] == "finished",
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetError(
            f"{folder}: recipe.json or run.json is of no run of glsim train: {error!r}"
        ) from None


@dataclass(frozen=True)
class Group:
    """The seeds of one network at one size: a row of a table."""

    members: Sequence[Trained]

    @property
    def title(self) -> str:
        """Of its recipe."""
        return self.members[0].title

    @property
    def row(self) -> str | None:
        """Of the paper."""
        return self.members[0].row

    @property
    def size(self) -> str:
        """full, small or own."""
        return self.members[0].size


def grouped(trained: Sequence[Trained]) -> list[Group]:
    """By title, row and size, in the order of the first of each; seeds in order."""
    groups: dict[tuple[str, str | None, str], list[Trained]] = {}
    for one in sorted(trained, key=lambda one: one.seed):
        groups.setdefault(one.network, []).append(one)
    return [Group(members) for members in groups.values()]
