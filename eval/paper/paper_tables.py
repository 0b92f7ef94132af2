"""The paper's tables 1 (filters), 2 and 3 (networks), with printed values beside our values."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from glsim.core.depth_protocol import MEANING
from glsim.core.errors import counted
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.metrics.ssim import PRESETS
from glsim.eval.paper.printed_values import (
    COPIES,
    PRINTED_FILTERS,
    PRINTED_NETWORKS,
    TEXTS,
    PrintedRow,
)
from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.score_tables import ResultTable, format_number
from glsim.eval.scoring.aggregate import MetricMean
from glsim.eval.scoring.evaluate import Evaluation
from glsim.eval.scoring.trained_networks import SeedGroup, TrainedRun, group_by_network
from glsim.networks.composites import COMPOSITES

#: Number of a table -> its rows. Table 2 compares architectures; table 3 compares DnCNNs of several
#: depths, with and without artefact removal (AR). Table 4, not the paper's, has all other networks.
PAPER_ROWS: Final = {
    1: PAPER_FILTERS,
    2: ("Restormer", "UNet", "D7", "D20", "D64"),
    3: ("D7", "AR D7", "D20", "AR D20", "D64", "AR D64"),
    4: (),
}
#: Names of the trivial predictions, a scale for the others.
TRIVIAL: Final = ("zero image", "mean face")
_TEXTS: Final = TEXTS["tables"]
#: Our metric -> heading of its column.
PAPER_COLUMNS: Final[dict[str, str]] = _TEXTS["printed_columns"]
_SURFACE_COLUMNS: Final[dict[str, str]] = _TEXTS["surface_columns"]


@dataclass(frozen=True)
class _Row:
    """A table row: name in the paper, description of our method, and scores of each seed."""

    name: str
    what: str
    printed: PrintedRow | None
    seeds: Sequence[Mapping[str, MetricMean]]

    def mean(self, metric: str) -> float:
        """Return the mean over seeds; NaN without scores."""
        values = [entries[metric].mean for entries in self.seeds]
        return statistics.fmean(values) if values else math.nan

    def cell(self, metric: str) -> str:
        """Return mean and standard deviation over seeds as text."""
        means = [entries[metric].mean for entries in self.seeds]
        return mean_and_spread(means, METRICS[metric].unit)


def mean_and_spread(values: Sequence[float], unit: str) -> str:
    """Format the mean over seeds and, for several finite values, their standard deviation."""
    if not values:
        return "-"
    text = format_number(statistics.fmean(values), unit)
    if len(values) < 2 or not all(map(math.isfinite, values)):  # a seed may predict no depth
        return text
    return f"{text} ± {format_number(statistics.stdev(values), unit)}"


def paper_table(
    which: int,
    evaluation: Evaluation,
    table: ResultTable,
    trained: Sequence[TrainedRun] = (),
    refused: Sequence[str] = (),
    size: str = "",
    note: str = "",
) -> Document:
    """Return the page of a table of the paper, with printed values and our values.

    Args:
        which: number of the table: 1, 2 or 3.
        table: label of a method -> its scores.
        refused: a reason for each network that was left out.
        size, note: end of the title and a paragraph: what was run.
    """
    groups = group_by_network(trained) if which > 1 else []
    rows = _network_rows(which, groups, table)
    rows += [
        _Row(PRINTED_FILTERS[name].title, "filter", PRINTED_FILTERS[name], [table[name]])
        for name in PAPER_FILTERS
        if which == 1 or name != "adaptive"
    ]
    labels = {run.label for run in trained}
    rows += [
        _Row("-", f"`{name}`", None, [entries])
        for name, entries in table.items()
        if name not in PAPER_FILTERS and name.split(" [")[0] not in labels
    ]
    baselines = evaluation.baselines
    rows += [
        _Row(f"**{name}**", "a scale", None, [baselines.entries(name)])
        for name in TRIVIAL
        if name in baselines.methods
    ]
    title = f"Table {which} of Kendrick, Yap and Tan: printed and measured{size}"
    document = Document(
        _TEXTS["rivals"].format(size=size) if which == 4 else title,
        [
            *filter(None, [note]),
            _TEXTS["means"].format(
                frames=counted(evaluation.frames, "frame"),
                people=counted(len(evaluation.summary.subjects), "subject"),
                protocol=evaluation.protocol,
                meaning=MEANING[evaluation.protocol],
            ),
            _printed_and_ours(rows, table["noisy"]["mse_mm2"].mean),
            _TEXTS["ssim"].format(preset=PRESETS["paper"]),
            *([_TEXTS["artefact_removal"]] if which == 3 else []),
            *([_TEXTS["trivial"]] if baselines.methods else []),
            Heading("What all-pixel metrics hide"),
            TextTable(
                ["row", "ours is", *(f"{text} ↓" for text in _SURFACE_COLUMNS.values())],
                [[row.name, row.what, *map(row.cell, _SURFACE_COLUMNS)] for row in rows],
            ),
        ],
    )
    of_table = [group for group in groups if group.row is None or group.row in PAPER_ROWS[which]]
    notes = [note for group in of_table for note in _training_notes(group)]
    notes += [f"left out: {why}" for why in refused]
    if notes:
        document.parts += [Heading("What is missing or less than published"), notes]
    return document


def _network_rows(which: int, groups: Sequence[SeedGroup], table: ResultTable) -> list[_Row]:
    """List the rows of networks: all rows of the paper, then our additional networks."""
    rows = []
    for name in (*PAPER_ROWS[which], None) if which > 1 else ():
        printed = PRINTED_NETWORKS[name] if name else None
        own = [group for group in groups if group.row == name]
        same = own or [group for group in groups if group.row == COPIES.get(name or "", "")]
        trained = [
            _Row(name or "-", f"{group.title}{of}, {group.training}", printed, seeds)
            for group in same
            for of in ("", *(f" [{composite}]" for composite in COMPOSITES))
            if (seeds := [table[r.label + of] for r in group.members if r.label + of in table])
        ]
        if name is not None and not trained:
            trained = [_Row(name, "**missing**", printed, [])]
        rows += trained
    return rows


def _printed_and_ours(rows: Sequence[_Row], noisy_mm2: float) -> TextTable:
    head = ["row", "ours is"]
    for heading in PAPER_COLUMNS.values():
        head += [f"{heading}, printed", "ours"]
    head += ["MSE over the noisy input's, printed", "ours", "SSIM, printed constants, ours"]
    printed_noisy = PRINTED_FILTERS["noisy"].mse_mm2
    lines = []
    for row in rows:
        printed = ["-"] * 4
        if (paper := row.printed) is not None:
            printed = [format_number(paper.mse_mm2), f"{paper.psnr_db:.2f}", f"{paper.ssim:.4f}"]
            printed.append(f"{paper.mse_mm2 / printed_noisy:.3f}")
        ratio = row.mean("mse_mm2") / noisy_mm2 if noisy_mm2 else math.nan
        ours = [*map(row.cell, PAPER_COLUMNS), "-" if math.isnan(ratio) else f"{ratio:.3f}"]
        pairs = [cell for pair in zip(printed, ours, strict=True) for cell in pair]
        lines.append([row.name, row.what, *pairs, row.cell("ssim_paper")])
    return TextTable(head, lines)


def _training_notes(group: SeedGroup) -> list[str]:
    """Return notes on differences from the published training and on interrupted trainings."""
    notes = [group.members[0].description] if group.members[0].description else []
    if unfinished := [run.label for run in group.members if run.state != "finished"]:
        notes.append(f"interrupted, scored as far as it came: {', '.join(unfinished)}")
    return [f"{group.title}, {group.size}: {note}" for note in notes]
