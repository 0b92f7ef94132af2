"""Write tables 2 and 3, the networks: the printed values beside ours."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Final

from glsim.denoise import COMPOSITES, PAPER_FILTERS
from glsim.depth_protocol import MEANING
from glsim.eval.paper.filter_table import trivial_rows, yes_or_no
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS, PrintedRow
from glsim.eval.paper.runs import SeedGroup, TrainedRun, group_by_network, with_twins
from glsim.eval.report.document import Document, Heading, TextTable
from glsim.eval.report.tables import TABLE_METRICS, ResultTable, format_number
from glsim.eval.scoring.aggregate import MetricMean
from glsim.eval.scoring.run import Evaluation
from glsim.eval.scoring.statistics import student_t_test

#: Table -> rows. Table 2 compares architectures, table 3 each depth with and without AR.
PAPER_ROWS: Final = {
    2: ("Restormer", "UNet", "D7", "D20", "D64"),
    3: ("D7", "AR D7", "D20", "AR D20", "D64", "AR D64"),
}
#: Metrics beside a printed column: metric -> heading in these tables. Of the readings of SSIM the
#: one with L of 16-bit maps has values like the printed ones; that with the printed constants is
#: the column after them, without a printed one beside it.
_PAPER_BLOCK: Final = {
    "mse_mm2": "MSE [mm²]",
    "psnr_db": "PSNR per image [dB]",
    "ssim_16bit": "SSIM (ours: L = 65535)",
}
_PRINTED_CONSTANTS: Final = {"ssim_paper": "SSIM with the printed constants, ours"}
_SURFACE_BLOCK: Final = {
    "both_interior_rmse_mm": "interior RMSE [mm]",
    "both_rmse_mm": "RMSE, valid in both [mm]",
    "normal_mean_deg": "normals [°]",
    "flips_px": "flipped pixels",
    "flying_px": "flying pixels",
}


class _Scores:
    """The scores of a network, seed by seed."""

    def __init__(self, group: SeedGroup, part: str, table: ResultTable) -> None:
        """Look up the scores.

        Args:
            group: the trainings.
            part: the composite of a network that returns probabilities; "" for one that does not.
            table: the scores by the label of a method.
        """
        self.group, self.part = group, part
        labels = {run.seed: f"{run.label} [{part}]" if part else run.label for run in group.members}
        self._entries = {seed: table[label] for seed, label in labels.items() if label in table}

    def __bool__(self) -> bool:
        return bool(self._entries)

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.group.title} [{self.part}]" if self.part else self.group.title

    @property
    def seeds(self) -> set[int]:
        """The seeds with scores."""
        return set(self._entries)

    def values(self, metric: str, seeds: Collection[int] | None = None) -> list[float]:
        """Return the mean of a metric over all frames for each seed; None selects all seeds."""
        wanted = self._entries if seeds is None else sorted(seeds)
        return [self._entries[seed][metric].mean for seed in wanted]

    def mean(self, metric: str) -> float:
        """Return the mean over seeds; NaN if it is undefined for a seed."""
        return statistics.fmean(self.values(metric))

    def cell(self, metric: str) -> str:
        """Return the text of mean and standard deviation over seeds."""
        values, unit = self.values(metric), TABLE_METRICS[metric].unit
        text = format_number(statistics.fmean(values), unit)
        if len(values) < 2 or not all(map(math.isfinite, values)):  # a seed may predict no depth
            return text
        return f"{text} ± {format_number(statistics.stdev(values), unit)}"


def _scored(groups: Sequence[SeedGroup], table: ResultTable) -> list[_Scores]:
    candidates = [_Scores(group, part, table) for group in groups for part in ("", *COMPOSITES)]
    return [scores for scores in candidates if scores]


def network_table(
    which: int,
    evaluation: Evaluation,
    table: ResultTable,
    trained: Sequence[TrainedRun],
    refused: Sequence[str] = (),
) -> Document:
    """Write table 2 or 3 beside our values, and the relations of the paper that hold.

    Networks without a row in the paper follow its rows.

    Args:
        which: number of the table.
        evaluation: the scores.
        table: the scores by the label of a method.
        trained: the scored networks.
        refused: reasons why other networks are left out.
    """
    groups = with_twins(group_by_network(trained))
    of_paper = [group for row in PAPER_ROWS[which] for group in groups if group.row == row]
    of_others = [group for group in groups if group.row is None]
    scored, own = _scored(of_paper, table), _scored(of_others, table)
    labels = {run.label for run in trained}
    filters = [n for n in table if n.split(" [")[0] not in labels and n != "adaptive"]
    document = Document(f"Table {which} of Kendrick, Yap and Tan: printed and measured")
    document.parts += [
        f"{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects. Protocol "
        f"{evaluation.protocol}: {MEANING[evaluation.protocol]}. Ours are "
        "means over seeds ± their standard deviation; one seed has none. Nothing is extrapolated: "
        "a row that was trained smaller says so, and its numbers stand for that size only.",
        _paper_table(which, scored, own, table, trivial_rows(evaluation)),
        "The paper's SSIM is not comparable between rows of other types: see the study of its "
        "readings (glsim paper ssim DATA).",
        Heading("What all-pixel metrics hide"),
        _surface_table([*scored, *own], filters, table),
        Heading("Relations"),
    ]
    if which == 3:
        document.parts += [
            "AR, artefact removal, maps the input back through the adjoint of the measurement "
            "operator before the network. In deepinv's class that operator is the identity for "
            "denoising: AR and no AR are the same network, and differ as two seeds do. That the "
            "paper used it so is an inference. The difference is that of the "
            "seeds that both have; t is that of the means of all seeds over its standard error "
            "(pooled over seeds); the last column asks whether |t| stays below what chance exceeds "
            "in 1 % of cases, unless the same seeds give the same.",
            _artefact_removal_table(scored),
        ]
    document.parts.append(_filter_comparison([*scored, *own], table))
    if own and scored:
        document.parts += [
            "Networks that know which pixels are holes, against the best of all other rows:",
            _own_comparison([s for s in own if s.part != "input mask"], scored, filters, table),
        ]
    missing = [row for row in PAPER_ROWS[which] if not any(s.group.row == row for s in scored)]
    notes = [f"{row}: missing, no checkpoint of it was found" for row in missing]
    notes += [note for group in (*of_paper, *of_others) for note in _training_notes(group)]
    notes += [f"left out: {why}" for why in refused]
    if notes:
        document.parts += [Heading("What is missing or less than published"), notes]
    return document


def _paper_table(
    which: int,
    scored: list[_Scores],
    own: list[_Scores],
    table: ResultTable,
    trivial: ResultTable,
) -> TextTable:
    head = ["row", "network", "size", "seeds", "minutes of training"]
    for heading in _PAPER_BLOCK.values():
        head += [f"{heading}, printed", f"{heading}, ours"]
    head += _PRINTED_CONSTANTS.values()
    rows: list[list[str]] = []
    for row in PAPER_ROWS[which]:
        printed = _printed_cells(PRINTED_NETWORKS[row])
        of_row = [scores for scores in scored if scores.group.row == row]
        for scores in of_row:
            rows.append([row, *_run_cells(scores, of_row), *_interleaved(printed, scores.cell)])
        if not of_row:
            rows.append([row, "**missing**", "", "", "", *_interleaved(printed, lambda _: "")])
    rows += [
        ["-", *_run_cells(scores, []), *_interleaved(["-"] * 3, scores.cell)] for scores in own
    ]
    for name in (name for name in PAPER_FILTERS if name in table and name != "adaptive"):
        printed = _printed_cells(PRINTED_FILTERS[name])
        cells = _interleaved(printed, partial(_number, table[name]))
        rows.append([PRINTED_FILTERS[name].title, "filter", "", "", "", *cells])
    for title, entries in trivial.items():
        cells = _interleaved(["-"] * 3, partial(_number, entries))
        rows.append([f"**{title}**", "no method may lose to it", "", "", "", *cells])
    return TextTable(head, rows)


def _number(entries: Mapping[str, MetricMean], metric: str) -> str:
    return format_number(entries[metric].mean, TABLE_METRICS[metric].unit)


def _printed_cells(row: PrintedRow) -> list[str]:
    """Return the printed values of the columns of ``_PAPER_BLOCK``."""
    return [format_number(row.mse_mm2), f"{row.psnr_db:.2f}", f"{row.ssim:.4f}"]


def _run_cells(scores: _Scores, of_row: Sequence[_Scores]) -> list[str]:
    group = scores.group
    size = group.size
    if group.row and size == "small" and not any(other.group.size == "full" for other in of_row):
        size = "small; **not run at full size**"
    minutes = statistics.fmean(run.minutes for run in group.members)
    return [scores.name, size, str(len(scores.values("mse_mm2"))), f"{minutes:.1f}"]


def _interleaved(printed: list[str], ours: Callable[[str], str]) -> list[str]:
    """Return the cells of a row: printed and ours by turns, then what has no printed column."""
    pairs = zip(printed, map(ours, _PAPER_BLOCK), strict=True)
    return [*(cell for pair in pairs for cell in pair), *map(ours, _PRINTED_CONSTANTS)]


def _surface_table(networks: list[_Scores], filters: list[str], table: ResultTable) -> TextTable:
    rows = [[s.name, s.group.size, *map(s.cell, _SURFACE_BLOCK)] for s in networks]
    for name in filters:
        cells = [format_number(table[name][metric].mean) for metric in _SURFACE_BLOCK]
        rows.append([_filter_name(name), "filter", *cells])
    head = [f"{heading} ↓" for heading in _SURFACE_BLOCK.values()]
    return TextTable(["network", "size", *head], rows)


def _filter_name(name: str) -> str:
    return PRINTED_FILTERS[name].title if name in PRINTED_FILTERS else f"`{name}`"


def _artefact_removal_table(scored: list[_Scores]) -> TextTable:
    rows: list[list[str]] = []
    metric = "mse_mm2"
    for plain in scored:
        for other in scored:
            pair = (f"AR {plain.group.row}", plain.group.size, plain.part)
            if (other.group.row, other.group.size, other.part) != pair:
                continue
            row = str(plain.group.row)
            printed = PRINTED_NETWORKS[f"AR {row}"].mse_mm2 - PRINTED_NETWORKS[row].mse_mm2
            both = plain.seeds & other.seeds
            ours = [values.values(metric, both) for values in (plain, other)]
            t, p = student_t_test(other.values(metric), plain.values(metric))
            if other.group.twin:
                verdict = "the same network, not trained again"
            elif both and ours[0] == ours[1]:
                verdict = "equal, seed by seed"
            else:
                verdict = "one seed: unknown" if math.isnan(t) else yes_or_no(p > 0.01)
            difference = statistics.fmean(ours[1]) - statistics.fmean(ours[0]) if both else math.nan
            cells = [
                f"{printed:+.0f}",
                f"{difference:+.1f}" if both else "no common seed",
                str(len(both)),
                plain.cell(metric),
                other.cell(metric),
            ]
            rows.append([row, plain.group.size, *cells, _defined(t), verdict])
    return TextTable(
        [
            *("depth", "size", "MSE of AR less no AR, printed", "ours", "in common seeds"),
            *("no AR, ours", "AR, ours", "t", "as between seeds"),
        ],
        rows,
    )


def _defined(value: float) -> str:
    """Return a number with two decimals, or - for NaN."""
    return "-" if math.isnan(value) else f"{value:.2f}"


def _filter_comparison(networks: list[_Scores], table: ResultTable) -> TextTable:
    filters = [
        name for name in PAPER_FILTERS if name in table and name not in ("noisy", "adaptive")
    ]
    lowest = {m: min(table[n][m].mean for n in filters) for m in ("mse_mm2", *_SURFACE_BLOCK)}
    rows = []
    for scores in networks:
        row = scores.group.row
        mse = scores.mean("mse_mm2")
        base = PRINTED_FILTERS["noisy"].mse_mm2
        printed = f"{PRINTED_NETWORKS[row].mse_mm2 / base:.1f}" if row else "-"
        rows.append(
            [
                scores.name,
                scores.group.size,
                printed,
                _ratio(mse, table["noisy"]["mse_mm2"].mean),
                _ratio(mse, table["median"]["mse_mm2"].mean),
                yes_or_no(mse > table["median"]["mse_mm2"].mean) if row else "-",
                _ratio(
                    scores.mean("both_interior_rmse_mm"),
                    table["noisy"]["both_interior_rmse_mm"].mean,
                ),
                _ratio(scores.mean("both_interior_rmse_mm"), lowest["both_interior_rmse_mm"]),
            ]
        )
    head = ["network", "size", "MSE over noisy, printed", "ours", "MSE over median's, ours"]
    head += ["loses to the median in MSE, as printed", "interior RMSE over noisy, ours"]
    return TextTable([*head, "over the paper's best filter"], rows)


def _ratio(value: float, base: float) -> str:
    return f"{value / base:.2f}" if base > 0 else "n/a"


def _own_comparison(
    own: list[_Scores], networks: list[_Scores], filters: list[str], table: ResultTable
) -> TextTable:
    rows = []
    for scores in own:
        for metric, heading in {"mse_mm2": _PAPER_BLOCK["mse_mm2"], **_SURFACE_BLOCK}.items():
            others = {s.name: s.mean(metric) for s in networks}
            others |= {_filter_name(name): table[name][metric].mean for name in filters}
            known = {name: value for name, value in others.items() if not math.isnan(value)}
            if not known:
                continue
            best = min(known, key=lambda name: known[name])
            ratio = _ratio(scores.mean(metric), known[best])
            rows.append([scores.name, heading, scores.cell(metric), best,
                         format_number(known[best]), ratio])  # fmt: skip
    return TextTable(
        ["network", "metric", "its value", "best of the others", "that one's", "ratio"], rows
    )


def _training_notes(group: SeedGroup) -> list[str]:
    """Return notes on settings smaller than published and on interrupted trainings."""
    notes = [f"{group.title}, {group.size}: {group.members[0].description}"]
    if unfinished := [run.label for run in group.members if not run.finished]:
        stopped = f"training was interrupted, scored as far as it came: {', '.join(unfinished)}"
        notes.append(f"{group.title}: {stopped}")
    return notes if group.members[0].description else notes[1:]
