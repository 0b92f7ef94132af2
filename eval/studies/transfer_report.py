"""Results of a transfer study: networks, noisy input and best filter, cell by cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.files.atomic import write_atomic
from glsim.eval.metrics.frame_score import METRICS as FRAME_METRICS
from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.score_tables import format_number
from glsim.eval.scoring.bias import (
    BIAS_BIN_MM,
    ENOUGH_PIXELS,
    BinSums,
    add_bias,
    bias_by_distance,
    largest_bias,
)
from glsim.eval.scoring.evaluate import write_csv
from glsim.eval.scoring.grid_search import SURFACE
from glsim.eval.scoring.statistics import SubjectSums, ratio_interval
from glsim.eval.studies.transfer_study import Cell, TransferStudy

#: The input, as a method.
NOISY: Final = "noisy"
#: Metric -> its title in the table by sensor, and what it is divided by there.
METRICS: Final = {
    SURFACE: ("interior RMSE", "filter"),
    "normal_mean_deg": ("normals", "filter"),
    "flips_px": ("flips", "input"),
    "flying_px": ("flying pixels", "input"),
}
_EXPLANATION: Final = (
    "A cell is one sensor with one source of faces in one scene; nobody in a test set was in "
    "training. Best filter: lowest mean of the table on the test frames themselves, which favours "
    "it; all were tuned on other people of the same cell (settings: transfer.csv). Ratios below 1 "
    "are better; in brackets the 95 % bootstrap interval over people."
)


@dataclass
class MethodScores:
    """The scores of a method for each person.

    Attributes:
        settings: the tuned ones.
        people: person -> (len(METRICS), 3) sum, defined frames and all frames of each metric.
        bias: person -> errors over distance.
    """

    settings: str = ""
    people: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    bias: dict[str, BinSums] = field(default_factory=dict)

    def values(self, metric: str) -> SubjectSums:
        """Return the sums of a metric, sorted by the person's name."""
        tables = np.stack([self.people[name] for name in sorted(self.people)])
        return SubjectSums(*tables[:, list(METRICS).index(metric)].T)

    def mean(self, metric: str) -> float:
        """Compute the mean over frames where the metric is defined; infinite if there is none."""
        mean = self.values(metric).mean
        return math.inf if math.isnan(mean) else mean


@dataclass(frozen=True, eq=False)
class CellResult:
    """The scores of a cell for the noisy input, the filters and a network ("" for no network)."""

    network: str
    cell: Cell
    scores: dict[str, MethodScores]

    def best_filter(self, metric: str) -> str:
        """Return the name of the filter with the lowest mean on the test frames."""
        filters = [name for name in self.scores if name not in (NOISY, self.network)]
        return min(filters, key=lambda name: self.scores[name].mean(metric))

    def row(self, metric: str) -> dict[str, Any]:
        """Return the values of a line of transfer.csv."""
        best = self.best_filter(metric)
        found = {
            "network": self.network,
            "sensor": self.cell.sensor.name,
            "faces": self.cell.source.name,
            "scene": self.cell.scene.name,
            "metric": metric,
            "noisy": self.scores[NOISY].mean(metric),
            "filter": best,
            "settings": self.scores[best].settings,
            "filter_mean": self.scores[best].mean(metric),
            "people": len(self.scores[best].people),
        }
        if not self.network:
            return found
        ours = self.scores[self.network].values(metric)
        found["network_mean"] = ours.mean
        for name, other in (("to_filter", best), ("to_input", NOISY)):
            ratio, low, high = ratio_interval(ours, self.scores[other].values(metric))
            found |= {name: ratio, f"{name}_low": low, f"{name}_high": high}
        return found


def write_transfer(
    study: TransferStudy, results: Sequence[CellResult], notes: Sequence[str], out: Path
) -> list[Path]:
    """Write transfer.md and transfer.csv, and return their paths.

    Args:
        study: what was run.
        results: scores by network and cell.
        notes: lines on the networks.
        out: folder.
    """
    document = Document(
        "Transfer: networks on sensors and faces that were not in training",
        [
            f"{study.title}. {study.test.people} people with {study.test.frames} frames each in a "
            f"cell. Errors are those from the {study.truth} depth. {_EXPLANATION}",
            *([list(notes)] if notes else []),
        ],
    )
    if any(result.network for result in results):
        document.parts += [
            Heading("By sensor, over all faces and scenes"),
            f"Largest bias: mean error in the worst {BIAS_BIN_MM} mm of distance with at least "
            f"{ENOUGH_PIXELS} interior pixels, mm.",
            _sensor_table([result for result in results if result.network]),
        ]
    rows = [result.row(metric) for metric in METRICS for result in results]
    for metric in METRICS:
        of_metric = [row for row in rows if row["metric"] == metric]
        document.parts += [Heading(FRAME_METRICS[metric].heading), _cell_table(of_metric)]
    paths = [out / "transfer.md", out / "transfer.csv"]
    write_atomic(document.markdown().encode(), paths[0])
    fields = list(dict.fromkeys(name for row in rows for name in row))
    write_csv(paths[1], fields, ([row.get(name, "") for name in fields] for row in rows))
    return paths


def _sensor_table(results: Sequence[CellResult]) -> TextTable:
    head = [f"{title} / {against}" for title, against in METRICS.values()]
    rows = []
    for pooled in pooled_by_sensor(results):
        ratios = [_ratio(pooled.row(m), f"to_{against}") for m, (_, against) in METRICS.items()]
        largest = largest_bias(bias_by_distance(pooled.scores[pooled.network].bias))
        bias = "n/a" if largest is None else f"{abs(largest.mean_mm):.2f}"
        rows.append([pooled.network, f"`{pooled.cell.sensor.name}`", *ratios, bias])
    return TextTable(["network", "sensor", *head, "largest bias [mm]"], rows)


def pooled_by_sensor(results: Sequence[CellResult]) -> list[CellResult]:
    """Pool a network's results over all cells of a sensor; equal face names are one person."""
    pooled: dict[tuple[str, str], CellResult] = {}
    for result in results:
        group = result.network, result.cell.sensor.name
        scores = pooled.setdefault(group, CellResult(result.network, result.cell, {})).scores
        for name, own in result.scores.items():
            total = scores.setdefault(name, MethodScores())
            for person, sums in own.people.items():
                key = f"{result.cell.source.name}/{person}"
                total.people[key] = sums + total.people.get(key, 0.0)
                add_bias({name: total.bias}, name, key, own.bias.get(person, {}))
    return list(pooled.values())


def _cell_table(rows: Sequence[dict[str, Any]]) -> TextTable:
    head = ["network", "sensor", "faces", "scene", "noisy", "best filter", "its mean",
            "network's mean", "/ filter", "/ noisy"]  # fmt: skip
    lines = [
        [
            *(row["network"] or "-", f"`{row['sensor']}`", row["faces"], row["scene"]),
            *(format_number(row["noisy"]), row["filter"], format_number(row["filter_mean"])),
            format_number(row.get("network_mean", math.nan)),
            *(_ratio(row, "to_filter"), _ratio(row, "to_input")),
        ]
        for row in rows
    ]
    return TextTable(head, lines)


def _ratio(row: dict[str, Any], name: str) -> str:
    value, low, high = (row.get(f"{name}{end}", math.nan) for end in ("", "_low", "_high"))
    if math.isnan(value):
        return "n/a"
    return f"{value:.2f}" if math.isnan(low) else f"{value:.2f} [{low:.2f}, {high:.2f}]"
