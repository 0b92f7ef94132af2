"""Search for the trained networks in FOLDER/*/, with their recipes and results.

It reads only JSON, and opens each checkpoint once, by ``glsim.load_denoiser``, to report
truncated or foreign ones before scoring starts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from pydantic import BaseModel, ValidationError

from glsim.core.errors import ConfigError, DatasetError, DenoiserError
from glsim.core.files.atomic import read_json
from glsim.data.reader import Dataset
from glsim.denoise.registry import load_denoiser
from glsim.simulation.plan.paper_sources import PAPER_SOURCES, STAND_IN, missing_counts


class TrainedRun(BaseModel):
    """A run of ``glsim train`` as described by its recipe.json and run.json.

    Attributes:
        checkpoint: its best checkpoint.
        title: title of the network.
        row: row in the paper's tables; None for another network.
        size: full, small or own.
        description: differences from the published training.
        seed: seed of the recipe.
        seconds: training time.
        steps: steps of the optimiser.
        state: finished, or interrupted.
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

    @property
    def label(self) -> str:
        """Name of the run in tables, which is the name of its folder."""
        return self.checkpoint.parent.name.replace("@", "-")

    @property
    def network(self) -> tuple[str, str | None, str]:
        """Title, row and size of the network, which are equal for all seeds."""
        return self.title, self.row, self.size

    @property
    def spec(self) -> str:
        """Specification of the denoiser for ``glsim.load_denoiser``."""
        return f"{self.label}@{self.checkpoint}"


def find_trained_runs(folder: Path) -> tuple[list[TrainedRun], list[str]]:
    """Find the trained networks of a folder, sorted by name.

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
    found = {"checkpoint": checkpoint}
    for name in ("recipe.json", "run.json"):
        found |= read_json(folder / name)
    try:
        return TrainedRun.model_validate(found)
    except ValidationError as error:
        raise DatasetError(
            f"{folder}: recipe.json or run.json is of no run of glsim train: "
            f"{error.errors()[0]['loc']}: {error.errors()[0]['msg']}"
        ) from None


class SeedGroup(NamedTuple):
    """The trainings of a network at one size with different seeds, which form a row of a table.

    Attributes:
        title: title of the recipe.
        row: row in the paper's tables, or None.
        size: full, small or own.
        members: the runs, in the order of their seeds.
    """

    title: str
    row: str | None
    size: str
    members: list[TrainedRun]


def group_by_network(trained: Sequence[TrainedRun]) -> list[SeedGroup]:
    """Group trainings of the same title, row and size, which differ in the seed only."""
    groups: dict[tuple[str, str | None, str], SeedGroup] = {}
    for run in sorted(trained, key=lambda run: run.seed):
        groups.setdefault(run.network, SeedGroup(*run.network, [])).members.append(run)
    return list(groups.values())


#: The rows that the paper prints with and without artefact removal.
_TWINNED: Final = ("D7", "D20", "D64")


def with_twins(groups: Sequence[SeedGroup]) -> list[SeedGroup]:
    """Add rows with artefact removal that were not trained, as copies of rows without it.

    The measurement operator of denoising is the identity, so that a network with and one without
    artefact removal are equal, bit for bit.
    """
    trained = {(group.row, group.size) for group in groups}
    twins = [
        group._replace(title=f"{group.title} again, as AR {group.row}", row=f"AR {group.row}")
        for group in groups
        if group.row in _TWINNED
    ]
    return [*groups, *(twin for twin in twins if (twin.row, twin.size) not in trained)]


_NAMES = {STAND_IN: "embedded heads", **{kind: s.name for kind, s in PAPER_SOURCES.items()}}


def data_note(dataset: Dataset) -> str:
    """Describe a data set in a caption: sources, numbers of frames, absent face sets, sensor.

    Args:
        dataset: of the reproduction.
    """
    held = Counter(str(pair.record["source"]) for pair in dataset)
    sources = ", ".join(f"{source_name(kind)} ({count:,})" for kind, count in held.items())
    note = f"Frames: {sources}."
    others = " and ".join(source_name(kind) for kind in held if kind not in PAPER_SOURCES)
    missing = missing_counts(held)
    if others and missing:
        lacks = ", ".join(f"{PAPER_SOURCES[kind].name} ({n:,})" for kind, n in missing.items())
        note += f" In place of {lacks}: {others}."
    return f"{note} Sensor: {dataset.sensor_title}."


def source_name(kind: str) -> str:
    """Return the name that captions use for a kind of face source."""
    return _NAMES.get(kind, kind)
