"""Results of a study: transfer.md, transfer.csv, transfer.json and transfer.png."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.figures.ratio_dots import RatioDot, ratio_dots
from glsim.eval.report.figures.style import to_png
from glsim.eval.report.tables import format_number
from glsim.eval.scoring.bias import BIAS_BIN_MM, ENOUGH_PIXELS, largest_bias
from glsim.eval.scoring.run import write_csv
from glsim.eval.transfer.comparison import (
    FIGURES,
    BiasComparison,
    CellResult,
    Figure,
    NetworkComparison,
    Ratio,
    compare,
    compare_bias,
    pool_by_sensor,
)
from glsim.eval.transfer.study import Goals, TransferStudy
from glsim.files.atomic import to_json, without_nan, write_atomic

_EXPLANATION: Final = (
    "A cell is one sensor with one source of faces; nobody in a test set was in training. *Best "
    "filter*: the one with the lowest mean of the table on the test frames themselves, which "
    "favours it; all were tuned on other people of the same cell and scene (settings: "
    "transfer.csv). *Ratio*: network over best filter, below 1 is better, with its 95 % bootstrap "
    "interval over people. *pass*: the goal is met; *?*: the interval holds the goal."
)


def write_results(
    study: TransferStudy,
    results: Sequence[CellResult],
    notes: Sequence[str],
    out: Path,
    *,
    figure: bool = True,
) -> list[Path]:
    """Write the files of the results; return their paths. notes: lines on how they were made.

    Raises DatasetError if a file cannot be written, GlsimError for a figure without Matplotlib.
    """
    pooled_results = pool_by_sensor(results)
    cells, pooled = (
        compare(results, study.goals),
        compare(pooled_results, study.goals),
    )
    bias = compare_bias(pooled_results)
    paths = [out / f"transfer.{suffix}" for suffix in ("md", "csv", "json")]
    write_atomic(
        _document(study, results, cells, pooled, bias, notes).markdown().encode(), paths[0]
    )
    write_csv(paths[1], list(_flat(cells[0])), (_flat(row) for row in [*pooled, *cells]))
    tree = {
        "study": study.model_dump(mode="json"),
        "notes": list(notes),
        "by_sensor": [_flat(row) for row in pooled],
        "cells": [_flat(row) for row in cells],
        "bias_by_distance": [asdict(row) for row in bias],
    }
    write_atomic((to_json(without_nan(tree), str(paths[2])) + "\n").encode(), paths[2])
    if figure:
        paths.append(out / "transfer.png")
        write_atomic(to_png(_figure(cells)), paths[-1])
    return paths


def _document(
    study: TransferStudy,
    results: Sequence[CellResult],
    cells: Sequence[NetworkComparison],
    pooled: Sequence[NetworkComparison],
    bias: Sequence[BiasComparison],
    notes: Sequence[str],
) -> Document:
    test, goals = study.test, study.goals
    truth = (
        "Errors are those about `expected`, what the device shows without random noise"
        if study.truth == "expected"
        else "Errors are those about the clean depth, so that they hold the device's systematic one"
    )
    document = Document(
        "Transfer: networks on sensors and faces that were not in training",
        [
            f"{study.title[0].upper()}{study.title[1:]}. {test.people} people with {test.frames} "
            f"frames each in a cell and scene. {truth}.",
            list(notes),
            _EXPLANATION,
            f"Goals: interior and normals at most {goals.tof_ratio:g} of the best filter under "
            f"sensors of time of flight (ToF), {goals.other_ratio:g} under others; flips at most "
            f"{goals.flips_ratio:g} and flying pixels at most {goals.flying_ratio:g} of the "
            f"input's; bias at most {goals.bias_mm:g} mm in each {BIAS_BIN_MM} mm of distance.",
            Heading("By sensor, over all faces and scenes"),
            _summary_table(results, pooled, bias, goals),
        ],
    )
    for figure in FIGURES:
        rows = [row for row in cells if row.figure == figure]
        title = f"{figure.title[0].upper()}{figure.title[1:]} [{figure.unit}]"
        document.parts += [Heading(title), _figure_table(figure, rows)]
    document.parts += [
        Heading("Bias over distance [mm]"),
        f"Mean error per {BIAS_BIN_MM} mm of distance (columns: lower edge, m), over interior "
        f"pixels of all faces and scenes; bins of fewer than {ENOUGH_PIXELS} pixels are left out. "
        "The filter is the best one by interior RMSE.",
        _bias_table(bias),
    ]
    return document


def _summary_table(
    results: Sequence[CellResult],
    pooled: Sequence[NetworkComparison],
    bias: Sequence[BiasComparison],
    goals: Goals,
) -> TextTable:
    """Return a row per network, left-out thing and sensor: the figures that goals are about."""
    tof = {result.sensor.name: result.sensor.tof for result in results}
    rows: dict[tuple[str, str, str], list[str]] = {}
    for row in pooled:
        key = (row.network, row.left_out, row.sensor)
        kind = "ToF" if tof[row.sensor] else "other"
        cells = rows.setdefault(key, [*_place(row), kind])
        cells.append(f"{_ratio(row.judged)} {row.verdict_text}")
    for item in bias:
        largest = item.largest_mm
        verdict = "pass" if largest <= goals.bias_mm else "**fail**"
        there = f"(input {item.input_there_mm:.2f})"
        text = "n/a" if math.isnan(largest) else f"{largest:.2f} {there} {verdict}"
        rows[item.network, item.left_out, item.sensor].append(text)
    against = {"filter": "/ best filter", "input": "/ input"}
    figures = [f"{figure.title} {against[figure.against]}" for figure in FIGURES]
    head = ["network", "left out", "sensor", "kind", *figures, "largest bias [mm]"]
    return _compact(head, list(rows.values()))


def _place(row: NetworkComparison | BiasComparison) -> list[str]:
    return [row.network, row.left_out, f"`{row.sensor}`"]


def _compact(head: list[str], rows: list[list[str]]) -> TextTable:
    """Return a table without the columns network and left out where they are the same in all."""
    kept = [n for n in range(len(head)) if n > 1 or len({row[n] for row in rows}) > 1]
    return TextTable([head[n] for n in kept], [[row[n] for n in kept] for row in rows])


def _figure_table(figure: Figure, rows: Sequence[NetworkComparison]) -> TextTable:
    head = ["network", "left out", "sensor", "faces", "scene", "noisy", "best filter",
            "the filter's", "the network's", "ratio"]  # fmt: skip
    if figure.against == "input":
        head.append("network / noisy")
    lines = []
    for row in rows:
        line = [*_place(row), row.source, row.scene, format_number(row.noisy), row.filter,
                format_number(row.filter_mean), format_number(row.network_mean),
                _ratio(row.to_filter)]  # fmt: skip
        if figure.against == "input":
            line.append(_ratio(row.to_input))
        lines.append([*line, row.verdict_text])
    return _compact([*head, "verdict"], lines)


def _bias_table(bias: Sequence[BiasComparison]) -> TextTable:
    known = [
        (item, role, {b.from_mm: b for b in bins if b.is_enough})
        for item in bias
        for role, bins in item.bins.items()
    ]
    edges = sorted({edge for _, _, bins in known for edge in bins})
    rows = []
    for item, role, bins in known:
        largest = largest_bias(bins.values())
        size = "n/a" if largest is None else f"{abs(largest.mean_mm):.2f}"
        means = [f"{bins[edge].mean_mm:+.2f}" if edge in bins else "" for edge in edges]
        rows.append([*_place(item), item.filter if role == "filter" else role, size, *means])
    head = ["network", "left out", "sensor", "method", "largest"]
    return _compact([*head, *(f"{edge / 1000:.1f}" for edge in edges)], rows)


def _ratio(ratio: Ratio) -> str:
    if math.isnan(ratio.value):
        return "n/a"
    text = f"{ratio.value:.2f}"
    return text if math.isnan(ratio.low) else f"{text} [{ratio.low:.2f}, {ratio.high:.2f}]"


def _flat(row: NetworkComparison) -> dict[str, Any]:
    """Return a comparison as one level of names and values."""
    flat: dict[str, Any] = {}
    for name, value in asdict(row).items():
        if name == "figure":
            flat |= {"metric": value["metric"], "unit": value["unit"]}
        elif name in ("to_filter", "to_input"):
            flat |= {f"{name}{'' if key == 'value' else '_' + key}": v for key, v in value.items()}
        else:
            flat[name] = "; ".join(value) if name == "settings" else value
    return flat | {"goal_is_about": f"to_{row.figure.against}", "verdict": row.verdict}


def _figure(cells: Sequence[NetworkComparison]) -> Any:
    """Draw the ratio of each cell and goal: rows are sensors, colours faces, circles scenes."""
    scenes = list(dict.fromkeys(row.scene for row in cells))
    panels = []
    for figure in FIGURES:
        dots = [
            RatioDot(
                row.sensor,
                _kind(row, cells),
                row.scene != scenes[0],
                row.judged.value,
                row.judged.low,
                row.judged.high,
                row.goal,
            )
            for row in cells
            if row.figure == figure
        ]
        against = "best filter" if figure.against == "filter" else "input"
        panels.append((f"{figure.title}\nnetwork / {against}", dots))
    return ratio_dots(panels, (scenes[0], " or ".join(scenes[1:])))


def _kind(row: NetworkComparison, cells: Sequence[NetworkComparison]) -> str:
    """Return what the colour of a dot shows: the faces, and what else differs between the rows."""
    parts = [row.source]
    if len({other.left_out.split()[0] for other in cells}) > 1:
        parts.append(f"{row.left_out.split()[0]} left out")
    elif len({other.network for other in cells if other.sensor == row.sensor}) > 1:
        parts.append(row.network)
    return ", ".join(parts)
