"""Score filters and networks under sensors and on faces that were not in training.

DIR/data/test/SENSOR/FACES/SCENE     frames of the people that are tested
DIR/data/train/SENSOR/FACES/SCENE    frames of the people that networks are trained on
DIR/runs/NAME                        a training
DIR/scores/SENSOR/FACES/SCENE/NAME   scores: filters, and each network
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from glsim.core.errors import DatasetError
from glsim.denoise import DEFAULT_COMPOSITE, GRIDS, load_denoiser
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.grid_search import tune_filters
from glsim.eval.scoring.run import Evaluation, evaluate
from glsim.eval.studies.runner import Runner
from glsim.eval.studies.transfer_report import (
    METRICS,
    NOISY,
    CellResult,
    MethodScores,
    write_transfer,
)
from glsim.eval.studies.transfer_study import Cell, Training, TransferStudy
from glsim.train.recipe import Recipe, load_recipe

#: Suffix of the name of a filter that also cleans the mask.
_CLEANED: Final = ", mask cleaned"

Scores = dict[str, MethodScores]


def run_transfer(
    study: TransferStudy,
    runner: Runner,
    networks: Mapping[str, str],
    trainings: Sequence[Training] = (),
) -> list[Path]:
    """Tune filters, train networks and score all of them; write transfer.md and transfer.csv.

    Results are written after each network, so that a long study shows what it has.

    Args:
        study: sensors, faces and scenes.
        runner: the folder, and how progress is shown.
        networks: name -> spec of ``glsim.load_denoiser``, scored on all cells.
        trainings: networks to train, each scored on its own cells.

    Returns:
        The written files.

    Raises:
        GlsimError: a step failed; the message names it.
        KeyboardInterrupt: a training was stopped by a signal.
    """
    for spec in networks.values():
        load_denoiser(spec)  # raises its error before any work starts
    recipe = _recipe(study) if trainings else None
    cells = study.cells() if networks or not trainings else ()
    tested = {c.place: c for c in (*cells, *(c for each in trainings for c in each.cells))}
    filters = {place: _score_filters(study, runner, cell) for place, cell in tested.items()}
    results = [CellResult("", cell, filters[cell.place]) for cell in cells if not networks]
    written = _write(study, runner, results, networks) if results else []
    for name, spec in networks.items():
        for cell in cells:
            scored = _score_network(study, runner, cell, name, spec)
            results.append(CellResult(name, cell, filters[cell.place] | scored))
        written = _write(study, runner, results, networks)
    for training in trainings:
        assert recipe is not None
        data = []
        for place, settings in study.training_settings(training).items():
            data.append(runner.out / "data" / "train" / place)
            runner.generate(settings, data[-1])
        run = runner.out / "runs" / training.name
        runner.train(recipe, data, run)
        for cell in training.cells:
            scored = _score_network(study, runner, cell, training.name, str(run / "best.pt"))
            results.append(CellResult(training.name, cell, filters[cell.place] | scored))
        written = _write(study, runner, results, networks)
    return written


def _write(
    study: TransferStudy, runner: Runner, results: list[CellResult], networks: Mapping[str, str]
) -> list[Path]:
    notes = [f"`{name}` is `{Path(spec).name}`, given" for name, spec in networks.items()]
    return write_transfer(study, results, notes, runner.out)


def _recipe(study: TransferStudy) -> Recipe:
    limits = {
        "training": {"max_steps": study.train.steps},
        "data": {"crop": study.train.crop, "target": study.truth},
    }
    return load_recipe(study.train.recipe, study.train.set, limits)


def _score_filters(study: TransferStudy, runner: Runner, cell: Cell) -> Scores:
    """Tune every filter on the validation people of a cell, and score it on the test people."""
    data = runner.out / "data" / "test" / cell.place
    runner.generate(study.test_settings(cell), data)
    out = runner.out / "scores" / cell.place / "filters"

    def run() -> Scores:
        with runner.displays.scoring("filters") as progress:
            job = ScoringJob(data, "val", (), truth=study.truth)
            tuned = tune_filters(job, list(GRIDS), out, workers=runner.workers, progress=progress)
            specs = {NOISY: NOISY}
            for item in tuned:
                specs |= {item.name: item.plain, f"{item.name}{_CLEANED}": item.cleaned}
            unique = tuple(dict.fromkeys(specs.values()))
            job = replace(job, split="test", denoisers=unique)
            evaluation = evaluate(
                job, out, workers=runner.workers, baselines=False, progress=progress
            )
        labels = {spec: load_denoiser(spec).label for spec in unique}
        return {name: _scores(evaluation, labels[spec], spec) for name, spec in specs.items()}

    return runner.step(f"score filters {cell.place.as_posix()}", run) or {}


def _score_network(
    study: TransferStudy, runner: Runner, cell: Cell, name: str, spec: str
) -> Scores:
    """Score a network on the test people of a cell."""
    data = runner.out / "data" / "test" / cell.place
    job = ScoringJob(data, "test", (f"network@{spec}",), truth=study.truth)

    def run() -> Scores:
        with runner.displays.scoring(name) as progress:
            evaluation = evaluate(
                job, runner.out / "scores" / cell.place / name, workers=runner.workers,
                baselines=False, progress=progress,
            )  # fmt: skip
        label = f"network [{DEFAULT_COMPOSITE}]"
        if label not in evaluation.summary.methods:
            label = "network"  # its validity is not soft
        return {name: _scores(evaluation, label, "")}

    return runner.step(f"score {name} {cell.place.as_posix()}", run) or {}


def _scores(evaluation: Evaluation, label: str, settings: str) -> MethodScores:
    """Return the sums of a method. Raises DatasetError if some frames were not scored."""
    if evaluation.bad:
        raise DatasetError(
            f"{evaluation.bad} frames or methods could not be scored, the first: "
            f"{evaluation.first_bad[0]}"
        )
    summary = evaluation.summary
    sums = {}
    for metric in METRICS:
        values = summary.values(label, metric)
        table = zip(values.sums, values.counts, values.frames, strict=True)
        sums[metric] = dict(zip(summary.subjects, table, strict=True))
    return MethodScores(settings, sums, summary.bias_sums.get(label, {}))
