"""Find the trained networks in FOLDER/*/, with their recipes and results.

This module reads only JSON. It opens each checkpoint once, by ``glsim.load_denoiser``, to report
truncated or foreign ones before scoring starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from glsim.core.errors import ConfigError, DatasetError, DenoiserError
from glsim.core.files.atomic import read_json
from glsim.denoise import load_denoiser


@dataclass(frozen=True)
class TrainedRun:
    """A run of ``glsim train``.

    Attributes:
        checkpoint: its best checkpoint.
        title: title of the network.
        row: row in the paper's tables; None for another network.
        size: full, small or own.
        description: differences from the published training.
        seed: seed of the recipe.
        minutes: training time.
        steps: steps of the optimiser.
        parameters: number of weights.
        finished: False if the training was interrupted.
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
        """Name in tables: that of the run's folder."""
        return self.checkpoint.parent.name.replace("@", "-")

    @property
    def network(self) -> tuple[str, str | None, str]:
        """Title, row and size: equal for the seeds of a network."""
        return self.title, self.row, self.size

    @property
    def spec(self) -> str:
        """Denoiser for ``glsim.load_denoiser``."""
        return f"{self.label}@{self.checkpoint}"


def find_trained_runs(folder: Path) -> tuple[list[TrainedRun], list[str]]:
    """Find the trained networks of a folder, in the order of their names.

    Args:
        folder: with a folder per run of ``glsim train``.

    Returns:
        The runs, and a reason for each checkpoint that is left out.

    Raises:
        ConfigError: if there is no such folder or no checkpoint in it.
    """
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
        else:  # counted twice, it would understate the spread over seeds
            refused.append(
                f"{checkpoint}: is the same recipe and seed as {first}: if it is another network, "
                "train it under another title (--set title=...)"
            )
    return runs, refused


def _read(checkpoint: Path) -> TrainedRun:
    folder = checkpoint.parent
    recipe = read_json(folder / "recipe.json")
    run = read_json(folder / "run.json")
    try:
        return TrainedRun(
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


#: Prefix of the rows with artefact removal.
ARTEFACT_REMOVAL: Final = "AR "


@dataclass(frozen=True)
class SeedGroup:
    """The trainings of one network at one size, one per seed: a row of a table.

    Attributes:
        members: the runs, in the order of their seeds.
        twin: whether it is the row with artefact removal of a network that was trained without: it
            is the same network, so that nothing is trained for it.
    """

    members: Sequence[TrainedRun]
    twin: bool = False

    @property
    def title(self) -> str:
        """Title of the recipe."""
        title = self.members[0].title
        return f"{title} again, as {self.row}" if self.twin else title

    @property
    def row(self) -> str | None:
        """Row in the paper's tables, or None."""
        row = self.members[0].row
        return f"{ARTEFACT_REMOVAL}{row}" if self.twin else row

    @property
    def size(self) -> str:
        """Size: full, small or own."""
        return self.members[0].size


def group_by_network(trained: Sequence[TrainedRun]) -> list[SeedGroup]:
    """Put the seeds of each network together.

    Args:
        trained: runs in any order.

    Returns:
        A group per title, row and size; its runs are in the order of their seeds.
    """
    groups: dict[tuple[str, str | None, str], list[TrainedRun]] = {}
    for run in sorted(trained, key=lambda run: run.seed):
        groups.setdefault(run.network, []).append(run)
    return [SeedGroup(members) for members in groups.values()]


def with_twins(groups: Sequence[SeedGroup]) -> list[SeedGroup]:
    """Add the rows with artefact removal that were not trained: each is its partner's network.

    The measurement operator of denoising is the identity, so that a network with and one without
    artefact removal are equal, bit for bit: in denoising it is the identity.
    """
    trained = {(group.row, group.size) for group in groups}
    twins = [SeedGroup(group.members, twin=True) for group in groups if group.row in _TWINNED]
    return [*groups, *(twin for twin in twins if (twin.row, twin.size) not in trained)]


#: The rows that the paper prints with and without artefact removal.
_TWINNED: Final = ("D7", "D20", "D64")
