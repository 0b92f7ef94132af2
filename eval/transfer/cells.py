"""Score filters and networks on the test sets of a cell, and pool cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from glsim.denoise import GRIDS, load_denoiser
from glsim.denoise.composites import DEFAULT_COMPOSITE
from glsim.errors import DatasetError
from glsim.eval.scoring.bias import BiasSums, BinSums, add_bias
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.grid_search import SURFACE, tune_filters
from glsim.eval.scoring.run import Evaluation, ScoringProgress, evaluate
from glsim.eval.scoring.statistics import SubjectSums

#: The input, as a method.
NOISY: Final = "noisy"
#: Suffix of the name of a filter that also cleans the mask.
CLEANED: Final = ", mask cleaned"
#: Names of the tuned filters.
FILTERS: Final = tuple(f"{name}{clean}" for name in GRIDS for clean in ("", CLEANED))
#: The metrics of the tables.
METRICS: Final = (SURFACE, "normal_mean_deg", "flips_px", "flying_px")

_Sums = tuple[float, float, float]
Watch = Callable[[ScoringProgress], None] | None


@dataclass
class MethodScores:
    """The scores of a method.

    Attributes:
        name: of the method.
        settings: the tuned ones, a text per data set.
        sums: metric -> person -> (sum, defined frames, all frames).
        bias: person -> errors over distance.

    """

    name: str
    settings: list[str] = field(default_factory=list)
    sums: dict[str, dict[str, _Sums]] = field(default_factory=dict)
    bias: dict[str, BinSums] = field(default_factory=dict)

    @property
    def people(self) -> list[str]:
        """The names of all people, sorted."""
        return sorted(self.sums[METRICS[0]])

    def values(self, metric: str) -> SubjectSums:
        """Return the sums of a metric, in the order of ``people``."""
        table = np.array([self.sums[metric][person] for person in self.people], np.float64)
        return SubjectSums(*table.reshape(-1, 3).T)

    def mean(self, metric: str) -> float:
        """Return the mean over the frames where the metric is defined."""
        return self.values(metric).mean


@dataclass
class CellScores:
    """Scores of methods on the same frames: filters by name, the input, and networks."""

    methods: dict[str, MethodScores] = field(default_factory=dict)

    def best_filter(self, metric: str) -> MethodScores:
        """Return the filter with the lowest mean on these test frames, which favours it."""
        filters = [scores for name, scores in self.methods.items() if name in FILTERS]
        known = [scores for scores in filters if not math.isnan(scores.mean(metric))]
        return min(known or filters, key=lambda scores: scores.mean(metric))


def score_filters(job: ScoringJob, out: Path, *, workers: int, watch: Watch = None) -> CellScores:
    """Tune every filter on the validation people of a data set, and score it on the test people.

    job: the test split; its denoisers are replaced. Raises the errors of ``evaluate``.
    """
    tuned = tune_filters(
        replace(job, split="val"), list(GRIDS), out, workers=workers, progress=watch
    )
    specs = {NOISY: NOISY}
    for item in tuned:
        specs[item.name] = item.plain
        specs[f"{item.name}{CLEANED}"] = item.cleaned
    unique = tuple(dict.fromkeys(specs.values()))
    evaluation = _whole(replace(job, denoisers=unique), out, workers, watch)
    labels = {spec: load_denoiser(spec).label for spec in unique}
    return CellScores(
        {name: _scores(evaluation, labels[spec], name, spec) for name, spec in specs.items()}
    )


def score_network(
    job: ScoringJob,
    name: str,
    network: str,
    out: Path,
    *,
    composite: str = DEFAULT_COMPOSITE,
    workers: int,
    watch: Watch = None,
) -> CellScores:
    """Score a network on the test people of a data set.

    Args:
        job: the test split; its denoisers are replaced.
        name: of the network in tables.
        network: spec of ``glsim.load_denoiser``.
        out: folder of the scores.
        composite: map of a soft validity, one of COMPOSITES.
        workers: number of processes.
        watch: called with the progress.

    """
    evaluation = _whole(replace(job, denoisers=(f"network@{network}",)), out, workers, watch)
    label = f"network [{composite}]"
    if label not in evaluation.summary.methods:
        label = "network"  # its validity is not soft
    return CellScores({name: _scores(evaluation, label, name, "")})


def _whole(job: ScoringJob, out: Path, workers: int, watch: Watch) -> Evaluation:
    """Score all frames. Raises DatasetError if some cannot be scored."""
    evaluation = evaluate(job, out, workers=workers, baselines=False, progress=watch)
    if evaluation.bad:
        raise DatasetError(
            f"{job.dataset}: {evaluation.bad} frames or methods could not be scored, the first: "
            f"{evaluation.first_bad[0]}"
        )
    return evaluation


def _scores(evaluation: Evaluation, label: str, name: str, settings: str) -> MethodScores:
    summary = evaluation.summary
    scores = MethodScores(name, [settings] if settings else [])
    for metric in METRICS:
        values = summary.values(label, metric)
        table = zip(values.sums.tolist(), values.counts.tolist(), values.frames.tolist(),
                    strict=True)  # fmt: skip
        scores.sums[metric] = dict(zip(summary.subjects, table, strict=True))
    scores.bias = summary.bias_sums.get(label, {})
    return scores


def pool(cells: Sequence[tuple[str, CellScores]]) -> CellScores:
    """Pool (faces, scores) of cells; equal names of faces mean the same people."""
    pooled = CellScores()
    bias: BiasSums = {}
    for faces, cell in cells:
        for name, scores in cell.methods.items():
            target = pooled.methods.setdefault(name, MethodScores(name))
            target.settings += [s for s in scores.settings if s not in target.settings]
            for metric, people in scores.sums.items():
                table = target.sums.setdefault(metric, {})
                for person, sums in people.items():
                    key = f"{faces}/{person}"
                    table[key] = _added((table.get(key, (0.0, 0.0, 0.0)), sums))
            for person, bins in scores.bias.items():
                add_bias(bias, name, f"{faces}/{person}", bins)
    for name, target in pooled.methods.items():
        target.bias = bias.get(name, {})
    return pooled


def _added(sums: Iterable[_Sums]) -> _Sums:
    first, second, third = (float(sum(column)) for column in zip(*sums, strict=True))
    return first, second, third
