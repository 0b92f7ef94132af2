"""Scoring of filters and networks on sensors and faces that were not in the training data.

DIR/data/test/SENSOR/FACES/SCENE     frames of the people that are tested
DIR/data/train/SENSOR/FACES/SCENE    frames of the people that networks are trained on
DIR/runs/NAME                        a training
DIR/scores/SENSOR/FACES/SCENE/NAME   scores: filters, and each network
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from glsim.core.errors import DatasetError
from glsim.denoise.registry import GRIDS, load_denoiser
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import evaluate
from glsim.eval.scoring.grid_search import tune_filters
from glsim.eval.studies.runner import Runner
from glsim.eval.studies.transfer_report import (
    METRICS,
    NOISY,
    CellResult,
    MethodScores,
    write_transfer,
)
from glsim.eval.studies.transfer_study import Cell, Training, TransferStudy
from glsim.networks.composites import DEFAULT_COMPOSITE
from glsim.train.recipe import load_recipe

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
    limits = {
        "training": {"max_steps": study.train.steps},
        "data": {"crop": study.train.crop, "target": study.truth},
    }
    recipe = load_recipe(study.train.recipe, study.train.set, limits)
    cells = study.cells() if networks or not trainings else ()
    tested = {c.place: c for c in (*cells, *(c for each in trainings for c in each.cells))}
    for cell in tested.values():
        study.test_settings(cell)  # likewise
    filters = {place: _score_filters(study, runner, cell) for place, cell in tested.items()}
    notes = [f"`{name}` is `{Path(spec).name}`, given" for name, spec in networks.items()]
    results: list[CellResult] = []
    if not networks and not trainings:
        results = [CellResult("", cell, filters[cell.place]) for cell in cells]
    for name, spec in networks.items():
        results += [_score_network(study, runner, cell, name, spec, filters) for cell in cells]
        write_transfer(study, results, notes, runner.out)
    for training in trainings:
        data = []
        for place, settings in study.training_settings(training).items():
            data.append(runner.out / "data" / "train" / place)
            runner.generate(settings, data[-1])
        run = runner.out / "runs" / training.name
        runner.train(recipe, data, run)
        results += [
            _score_network(study, runner, cell, training.name, str(run / "best.pt"), filters)
            for cell in training.cells
        ]
        write_transfer(study, results, notes, runner.out)
    return write_transfer(study, results, notes, runner.out)


def _score_filters(study: TransferStudy, runner: Runner, cell: Cell) -> Scores:
    """Tune every filter on the validation people of a cell and score it on the test people."""
    data = runner.out / "data" / "test" / cell.place
    runner.generate(study.test_settings(cell), data)
    out = runner.out / "scores" / cell.place / "filters"

    def run() -> Scores:
        job = ScoringJob(data, "val", (), truth=study.truth)
        with runner.displays.scoring("filters") as progress:
            tuned = tune_filters(job, list(GRIDS), out, workers=runner.workers, progress=progress)
        specs = {NOISY: NOISY}
        for item in tuned:
            specs |= {item.name: item.plain, f"{item.name}, mask cleaned": item.cleaned}
        job = replace(job, split="test", denoisers=tuple(dict.fromkeys(specs.values())))
        summary = _summary(job, out, runner, "filters")
        return {n: _scores(summary, load_denoiser(s).label, s) for n, s in specs.items()}

    return runner.step(f"score filters {cell.place.as_posix()}", run) or {}


def _score_network(
    study: TransferStudy,
    runner: Runner,
    cell: Cell,
    name: str,
    spec: str,
    filters: Mapping[Path, Scores],
) -> CellResult:
    """Score a network on the test people of a cell; return its scores with the filters' scores."""
    data = runner.out / "data" / "test" / cell.place
    job = ScoringJob(data, "test", (f"network@{spec}",), truth=study.truth)

    def run() -> Scores:
        summary = _summary(job, runner.out / "scores" / cell.place / name, runner, name)
        soft = f"network [{DEFAULT_COMPOSITE}]"
        return {name: _scores(summary, soft if soft in summary.methods else "network", "")}

    scored = runner.step(f"score {name} {cell.place.as_posix()}", run) or {}
    return CellResult(name, cell, filters[cell.place] | scored)


def _summary(job: ScoringJob, out: Path, runner: Runner, title: str) -> ScoreSummary:
    """Score a job. Raises DatasetError if some frames were not scored."""
    with runner.displays.scoring(title) as progress:
        evaluation = evaluate(job, out, workers=runner.workers, baselines=False, progress=progress)
    if evaluation.bad:
        raise DatasetError(
            f"{evaluation.bad} frames or methods could not be scored, the first: "
            f"{evaluation.first_bad[0]}"
        )
    return evaluation.summary


def _scores(summary: ScoreSummary, label: str, settings: str) -> MethodScores:
    values = [summary.values(label, metric) for metric in METRICS]
    sums = np.array([(each.sums, each.counts, each.frames) for each in values])
    people = dict(zip(summary.subjects, np.moveaxis(sums, -1, 0), strict=True))
    return MethodScores(settings, people, summary.bias_sums.get(label, {}))
