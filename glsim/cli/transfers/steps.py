"""The steps of ``glsim transfer``: data sets, tuned filters, trainings, scores; each resumable.

DIR/data/test/SENSOR/FACES/SCENE     frames of the people that are tested
DIR/data/train/SENSOR/FACES/SCENE    frames of the people that networks are trained on
DIR/runs/NAME                        a training; NAME says what it was trained on
DIR/scores/SENSOR/FACES/SCENE/NAME   scores: filters, and each network
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from glsim.cli.common import print_message
from glsim.cli.progress import generation_progress, scoring_progress
from glsim.cli.train import stopping, training_progress
from glsim.dataset import generate
from glsim.dataset.disk_format import HEADER
from glsim.denoise import GRIDS
from glsim.denoise.registry import CLEANUPS, tuning_specs
from glsim.errors import DatasetError
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.transfer.cases import Case, TrainingSet
from glsim.eval.transfer.cells import CellScores, score_filters, score_network
from glsim.eval.transfer.comparison import CellResult
from glsim.eval.transfer.study import DataSet, TransferStudy
from glsim.files.atomic import read_json

if TYPE_CHECKING:
    from glsim.train import Recipe

Kind = Literal["generate", "filters", "train", "network"]
#: Seconds of one core per unit of work, until a run has measured its own: a frame of 128 x 128 made
#: or scored by one method, a step of the recipe ``face``. Measured on a two-core cloud machine.
_TYPICAL_S: Final[dict[Kind, float]] = {
    "generate": 0.06,
    "filters": 0.02,
    "train": 0.6,
    "network": 0.1,
}
#: Settings that tuning tries for all filters, and the methods that are scored after it.
_TRIALS: Final = sum(len(tuning_specs(name, (0,))) for name in GRIDS) + len(GRIDS) * len(CLEANUPS)
_TUNED: Final = 2 * len(GRIDS) + 1


@dataclass(frozen=True)
class Step:
    """A step of the study.

    Attributes:
        amount: its units of work.
        complete: whether the folder seems to hold its results.
        run: does the step and returns the units of work that it did now.
    """

    kind: Kind
    title: str
    amount: int
    complete: Callable[[], bool]
    run: Callable[[], int]


@dataclass
class Pace:
    """Seconds per unit of each kind of work: typical ones, then those of this run."""

    workers: int
    _seconds: dict[Kind, float] = field(default_factory=dict)
    _units: dict[Kind, int] = field(default_factory=dict)

    def note(self, kind: Kind, units: int, seconds: float) -> None:
        """Count work that was done."""
        if units:
            self._seconds[kind] = self._seconds.get(kind, 0.0) + seconds
            self._units[kind] = self._units.get(kind, 0) + units

    def seconds(self, steps: Sequence[Step]) -> float:
        """Estimate the time of the steps that are not complete, seconds."""
        return sum(self._per_unit(s.kind) * s.amount for s in steps if not s.complete())

    def _per_unit(self, kind: Kind) -> float:
        if kind in self._units:
            return self._seconds[kind] / self._units[kind]
        return _TYPICAL_S[kind] / (1 if kind == "train" else self.workers)


@dataclass(frozen=True)
class Network:
    """A network to score.

    Attributes:
        name: in tables and folders.
        case: the cells that test it.
        composite: the map that is scored if its validity is soft.
    """

    name: str
    file: str
    case: Case
    composite: str


class StudyRun:
    """The steps of a study in a folder, and the results so far."""

    def __init__(
        self, study: TransferStudy, cases: Sequence[Case], out: Path, workers: int
    ) -> None:
        self.study, self.cases, self.out, self.workers = study, cases, out, workers
        self._filters: dict[Path, CellScores] = {}
        self._networks: dict[tuple[Path, str], CellScores] = {}

    def test_steps(self) -> Iterator[Step]:
        """Yield the steps that make the test sets, and tune and score the filters on them."""
        tests = {data.place: data for case in self.cases for data in self._tests(case)}
        for data in tests.values():
            yield self._generate(data)
            yield self._score_filters(data)

    def training_steps(self, training: TrainingSet, recipe: Recipe) -> Iterator[Step]:
        """Yield the steps that make the data of a training, and the training."""
        sets = [
            data
            for sensor in training.sensors
            for source in training.sources
            for data in self.study.training_sets(sensor, source)
        ]
        yield from map(self._generate, sets)
        yield self._train(training, sets, recipe)

    def network_steps(self, network: Network) -> Iterator[Step]:
        """Yield the steps that score a network on the cells of its case."""
        return (self._score_network(data, network) for data in self._tests(network.case))

    def checkpoint(self, training: TrainingSet) -> Path:
        """Return the file of a trained network."""
        return self.out / "runs" / training.name / "best.pt"

    def results(self, networks: Sequence[Network]) -> list[CellResult]:
        """Return what has been scored, in the order of the networks and their cells."""
        found: dict[tuple[str, str, Path], CellResult] = {}
        for network in networks:
            for data in self._tests(network.case):
                scored = self._networks.get((data.place, network.name))
                if scored is not None and data.place in self._filters:
                    methods = self._filters[data.place].methods | scored.methods
                    found[network.name, network.case.title, data.place] = CellResult(
                        network.name,
                        network.case.title,
                        data.sensor,
                        data.source.name,
                        data.scene.name,
                        CellScores(methods),
                    )
        return list(found.values())

    def _tests(self, case: Case) -> list[DataSet]:
        return [
            data for sensor, source in case.cells for data in self.study.test_sets(sensor, source)
        ]

    def _generate(self, data: DataSet) -> Step:
        folder = self.out / data.place

        def run() -> int:
            with generation_progress() as progress:
                summary = generate(
                    self.study.settings_of(data), folder, workers=self.workers, progress=progress
                )
            for why, count in summary.skipped.items():
                print_message(f"skipped {count}: {why}")
            if not sum(summary.frames.values()):
                raise DatasetError(f"{folder}: no frame could be made, see skipped.jsonl there")
            return summary.rendered

        title = f"{data.frames} frames to {data.part} with: {data.cell}"
        return Step("generate", title, data.frames, (folder / HEADER).exists, run)

    def _score_filters(self, data: DataSet) -> Step:
        out = self._scores(data, "filters")
        tune_frames, frames = (people * data.frames_per_person for people in data.people[1:])
        amount = tune_frames * _TRIALS + frames * _TUNED

        def run() -> int:
            fresh = not (out / "rows.csv").exists()
            with scoring_progress("filters") as watch:
                self._filters[data.place] = score_filters(
                    self._job(data), out, workers=self.workers, watch=watch
                )
            return amount if fresh else 0

        title = f"filters, tuned and scored: {data.cell}"
        return Step("filters", title, amount, (out / "rows.csv").exists, run)

    def _score_network(self, data: DataSet, network: Network) -> Step:
        out = self._scores(data, network.name)
        frames = data.people[2] * data.frames_per_person

        def run() -> int:
            fresh = not (out / "rows.csv").exists()
            with scoring_progress(network.name) as watch:
                self._networks[data.place, network.name] = score_network(
                    self._job(data), network.name, network.file, out,
                    composite=network.composite, workers=self.workers, watch=watch,
                )  # fmt: skip
            return frames if fresh else 0

        title = f"{network.name}, scored: {data.cell}"
        return Step("network", title, frames, (out / "rows.csv").exists, run)

    def _train(self, training: TrainingSet, sets: Sequence[DataSet], recipe: Recipe) -> Step:
        folder = self.checkpoint(training).parent
        steps = recipe.training.max_steps or 0

        def run() -> int:
            from glsim.train.batches import stored_batches
            from glsim.train.loop import fit

            before = _steps_done(folder)
            pairs = stored_batches([self.out / data.place for data in sets], recipe)
            with stopping() as stop, training_progress(training.name) as show:
                report = fit(recipe, pairs, folder, resume=True, on_step=show, should_stop=stop)
            if report["state"] == "interrupted":
                raise KeyboardInterrupt
            return max(0, int(report["steps"]) - before)

        title = f"training {training.name}: {steps} steps"
        return Step("train", title, steps, lambda: _steps_done(folder) >= steps, run)

    def _job(self, data: DataSet) -> ScoringJob:
        return ScoringJob(self.out / data.place, "test", (), truth=self.study.truth)

    def _scores(self, data: DataSet, name: str) -> Path:
        return self.out / "scores" / data.cell / name


def _steps_done(run: Path) -> int:
    """Return the steps of a training's last saved state; 0 without one."""
    try:
        return int(read_json(run / "run.json").get("steps", 0))
    except DatasetError:
        return 0
