"""Result tables as documents, Markdown and CSV, with all values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Final

from glsim.core.depth_map import FLYING_MM
from glsim.core.depth_protocol import MEANING
from glsim.core.errors import counted
from glsim.core.units import MM_PER_M
from glsim.denoise.registry import NETWORKS, denoiser_names
from glsim.eval.metrics.frame_score import METRICS
from glsim.eval.metrics.metric import GROUPS, Metric
from glsim.eval.metrics.regions import REGION_METRICS
from glsim.eval.report.document import TEXTS, Document, Heading, TextTable
from glsim.eval.scoring.aggregate import MetricMean, ScoreSummary
from glsim.eval.scoring.bias import BIAS_BIN_MM, ENOUGH_PIXELS, largest_bias
from glsim.eval.scoring.evaluate import Evaluation, write_csv
from glsim.eval.scoring.statistics import paired_difference
from glsim.networks.composites import COMPOSITES

#: Method -> metric -> mean over the set.
ResultTable = dict[str, dict[str, MetricMean]]

#: Sections of table.md: title -> metrics; table.csv has all metrics.
TABLE_SECTIONS: Final[dict[str, list[str]]] = {
    title: [m.name for m in METRICS.values() if m.in_table and m.group == group]
    for group, title in GROUPS.items()
}
#: A method harms surfaces if this metric is worse than its input's; label of the input in tables.
_INSIDE, _INPUT = "input_interior_rmse_mm", "noisy"
#: The metrics of trivial baselines in tables.
_BASELINE_METRICS: Final = (
    *("mse_mm2", "psnr_db", "ssim_paper", "ssim_standard", "iou", "flips_px", "both_rmse_mm"),
    "normal_mean_deg",
)
#: Results with fewer subjects get a warning. Chosen: 3 subjects have only 3^3 = 27 bootstrap draws.
FEW_SUBJECTS: Final = 5


def format_number(value: float, unit: str = "mm") -> str:
    """Format a value with about four digits, or a share (unit "1") with four decimals."""
    if math.isnan(value):
        return "n/a"
    digits = max(0, min(2, 3 - math.floor(math.log10(abs(value))))) if value else 0
    digits = 4 if unit == "1" else digits
    text = f"{value:.{digits}f}"
    return text if float(text) else text.removeprefix("-")  # not -0


def best_methods(table: ResultTable, metric: Metric) -> set[str]:
    """Return the methods with the best mean; means with equal printed digits are equal."""
    means = {name: entries[metric.name].mean for name, entries in table.items()}
    known = {name: value for name, value in means.items() if not math.isnan(value)}
    if metric.better == "neither" or len(known) < 2:
        return set()
    top = format_number((max if metric.better == "higher" else min)(known.values()), metric.unit)
    return {name for name, value in known.items() if format_number(value, metric.unit) == top}


def in_order(summary: ScoreSummary, methods: Sequence[str], tuned: Sequence[str] = ()) -> list[str]:
    """Sort methods: the input, the best inside, the best filter, others; last ``tuned`` ones."""
    means = {name: summary.mean(name, _INSIDE) for name in methods if name != _INPUT}
    ranked = sorted((n for n in means if not math.isnan(means[n])), key=means.__getitem__)
    filters = {*denoiser_names()} - {*NETWORKS}
    best_filter = [name for name in ranked if _denoiser(name) in filters][:1]
    first = [name for name in (_INPUT, *ranked[:1], *best_filter) if name in methods]
    order = dict.fromkeys([*first, *methods])
    return sorted(order, key=lambda name: name in tuned and name not in ranked[:1])


def _denoiser(label: str) -> str:
    """Return the denoiser's name in a label such as "guided:radius=2" or "face [measured]"."""
    return re.split("[: ]", label)[0]


#: Metric -> what its winner is best at.
_CONTESTS: Final = {_INSIDE: "inside surfaces", "flips_px": "in which pixels have depth"}


def result_lines(summary: ScoreSummary) -> list[str]:
    """Say for surfaces and masks which method is best, and how the user's best one stands to it.

    Then say which methods have a larger error than their input on its interior pixels.
    Differences are paired by subject. A method of the user has a label that no denoiser of glsim
    has.
    """
    lines, shipped = [], denoiser_names()
    for name, what in _CONTESTS.items():
        means = {method: summary.mean(method, name) for method in summary.methods}
        order = sorted((m for m in means if not math.isnan(means[m])), key=means.__getitem__)
        if len(order) < 2:
            continue
        first, second = order[:2]
        own = next((m for m in order if _denoiser(m) not in shipped), first)
        for other in dict.fromkeys((second, second if own == first else own)):
            gap = paired_difference(summary.values(first, name), summary.values(other, name))
            unit = METRICS[name].unit
            size, low, high = (format_number(-x, unit) for x in (gap.mean, gap.high, gap.low))
            interval = f" (95 % interval {low} to {high})"
            if gap.subjects < FEW_SUBJECTS:
                interval = f" (too few people for an interval: {FEW_SUBJECTS} are needed)"
            people = f"in {gap.lower} of {counted(gap.subjects, 'person', 'people')}"
            if gap.high < 0:
                line = f"is best {what}: {size} {unit} better than `{other}`{interval}, {people}"
            else:
                line = f"and `{other}` are not told apart {what}: {size} {unit}{interval}, "
                line += f"the first better {people}"
            lines.append(f"`{first}` {line}.")
    inside = {method: summary.mean(method, _INSIDE) for method in summary.methods}
    before = inside.get(_INPUT, math.nan)
    worse = {method: worse_inside(mean, before) for method, mean in inside.items()}
    return lines + [f"`{method}` is {line}" for method, line in worse.items() if line]


def worse_inside(error_mm: float, before_mm: float) -> str:
    """Say that an error inside surfaces is above its input's; "" where both print alike."""
    worse = f"worse inside than its input: {error_mm:.3g} against {before_mm:.3g} mm"
    return worse if error_mm > 1.01 * before_mm else ""


def _minus_best(summary: ScoreSummary) -> dict[str, str]:
    """Return each method's error inside surfaces minus the smallest one, with a paired interval."""
    values = {method: summary.values(method, _INSIDE) for method in summary.methods}
    known = {method: sums.mean for method, sums in values.items() if not math.isnan(sums.mean)}
    best = min(known, key=known.__getitem__, default="")
    cells = {}
    for method in known:
        gap = paired_difference(values[method], values[best])
        mean, low, high = (format_number(x) for x in (gap.mean, gap.low, gap.high))
        few = gap.subjects < FEW_SUBJECTS or method == best
        cells[method] = mean if few else f"{mean} [{low}, {high}]"
    return cells


def table_markdown(evaluation: Evaluation, table: ResultTable, heading: str) -> str:
    """Return the text of table.md, which contains all documents of the result."""
    protocol = f"Protocol {evaluation.protocol}: {MEANING[evaluation.protocol]}."
    documents = [*result_documents(evaluation, table), *note_documents(evaluation, table)]
    head = Document(heading, [protocol]).markdown()
    return "\n".join([head, *(document.markdown(level=2) for document in documents)])


def result_documents(evaluation: Evaluation, table: ResultTable) -> list[Document]:
    """Return the tables of scores, face parts, bias and baselines; empty tables are left out."""
    people = len(evaluation.summary.subjects)
    enough = people >= FEW_SUBJECTS
    words = {"frames": counted(evaluation.frames, "frame"), "people": counted(people, "subject")}
    words["intervals"] = TEXTS["scores"]["intervals"] if enough else ""
    scores = Document("Scores", [TEXTS["scores"]["head"].format(**words)])
    for title, names in TABLE_SECTIONS.items():
        metrics = [METRICS[name] for name in names]
        heads = [f"{m.heading} {m.arrow}".strip() for m in metrics]
        scores.parts.append(Heading(title))
        if title == GROUPS["paper"]:
            scores.parts.append(TEXTS["scores"]["paper"])
        gaps = _minus_best(evaluation.summary) if _INSIDE in names else {}
        scores.parts.append(_table(table, metrics, heads, intervals=enough, gaps=gaps))
    won = [Document("Result", [result_lines(evaluation.summary)])]
    others = (_region_document(table), _bias_document(evaluation.summary), _baselines(evaluation))
    return [*won, scores, *(document for document in others if document is not None)]


def note_documents(evaluation: Evaluation, table: ResultTable) -> list[Document]:
    """Return the definitions of the metrics, and remarks on the result if there are any."""
    shown = [METRICS[name] for names in TABLE_SECTIONS.values() for name in names]
    lines = [f"**{m.heading}** (`{m.name}`): {m.help}." for m in shown]
    parts = {name: means for name, means in COMPOSITES.items() if f" [{name}]" in " ".join(table)}
    lines += [f"**[{name}]** behind a network: {means}." for name, means in parts.items()]
    documents = [Document("Definitions", [lines])]
    notes = _remarks(evaluation, table)
    return [*documents, Document("Remarks", [notes])] if notes else documents


def _table(
    table: ResultTable, metrics: Sequence[Metric], heads: Sequence[str], *, intervals: bool = False,
    gaps: Mapping[str, str] | None = None,
) -> TextTable:  # fmt: skip
    """Return a row per method, best means bold, without metrics that no frame has.

    ``gaps`` stand beside the error inside surfaces.
    """
    known = [any(entries[m.name].frames for entries in table.values()) for m in metrics]
    metrics, heads = list(compress(metrics, known)), list(compress(heads, known))
    tops = {m.name: best_methods(table, m) for m in metrics}
    rows = []
    for method, entries in table.items():
        cells = [f"`{method}`"]
        for m in metrics:
            entry = entries[m.name]
            numbers = (entry.mean, entry.low, entry.high)
            mean, low, high = (format_number(number, m.unit) for number in numbers)
            text = f"**{mean}**" if method in tops[m.name] else mean
            spread = intervals and not math.isnan(entry.low)
            cells.append(f"{text} [{low}, {high}]" if spread else text)
        rows.append(cells)
    head = ["method", *heads]
    if gaps:
        place = 2 + [m.name for m in metrics].index(_INSIDE)
        head.insert(place, "inside, minus the best [mm]")
        for cells, method in zip(rows, table, strict=True):
            cells.insert(place, gaps.get(method, "n/a"))
    return TextTable(head, rows)


def _region_document(table: ResultTable) -> Document | None:
    """Return a table per region metric, with a column per face part; None without face parts."""
    first = next(iter(table.values()))
    document = Document("Parts of the face", [TEXTS["scores"]["regions"]])
    for name in REGION_METRICS:
        metrics = [
            entry.metric
            for entry in first.values()
            if entry.metric.name.startswith(f"{name}@")
            and any(entries[entry.metric.name].frames for entries in table.values())
        ]
        if metrics:
            title = f"{name} [{metrics[0].unit}] {metrics[0].arrow}".strip()
            parts = [m.name.partition("@")[2] for m in metrics]
            document.parts += [Heading(title), _table(table, metrics, parts)]
    return document if len(document.parts) > 1 else None


def _bias_document(summary: ScoreSummary) -> Document | None:
    """Return the table of each method's bias by distance; None if no bin has enough pixels."""
    by_method = {
        method: {b.from_mm: b for b in summary.bias_by_distance(method) if b.is_enough}
        for method in summary.methods
    }
    edges = sorted({edge for bins in by_method.values() for edge in bins})
    if not edges:
        return None
    rows = []
    for method, bins in by_method.items():
        largest = largest_bias(bins.values())
        size = "n/a" if largest is None else f"{abs(largest.mean_mm):.2f}"
        means = [f"{bins[edge].mean_mm:+.2f}" if edge in bins else "n/a" for edge in edges]
        rows.append([f"`{method}`", size, *means])
    note = TEXTS["scores"]["bias"].format(bin=BIAS_BIN_MM, flying=FLYING_MM, enough=ENOUGH_PIXELS)
    head = ["method", "largest ↓", *(f"{edge / MM_PER_M:.1f}" for edge in edges)]
    return Document("Bias over distance [mm]", [note, TextTable(head, rows)])


def _baselines(evaluation: Evaluation) -> Document | None:
    baselines = evaluation.baselines
    if not baselines.methods:
        return None
    metrics = [METRICS[name] for name in _BASELINE_METRICS]
    rows = [
        [name, *(format_number(baselines.mean(name, m.name), m.unit) for m in metrics)]
        for name in baselines.methods
    ]
    head = ["prediction", *(f"{m.heading} {m.arrow}" for m in metrics)]
    few = len(evaluation.summary.subjects) < FEW_SUBJECTS
    text = TEXTS["scores"]["trivial"] + (TEXTS["scores"]["own_mean"] if few else "")
    return Document("Trivial predictions: a scale for the above", [text, TextTable(head, rows)])


def _remarks(evaluation: Evaluation, table: ResultTable) -> list[str]:
    """List warnings: few subjects, undefined metrics, and frames that could not be scored."""
    lines = []
    if (subjects := len(evaluation.summary.subjects)) < FEW_SUBJECTS:
        people = counted(subjects, "subject")
        lines.append(TEXTS["scores"]["few"].format(people=people, enough=FEW_SUBJECTS))
    undefined: dict[tuple[int, str], list[str]] = {}
    for name in (name for names in TABLE_SECTIONS.values() for name in names):
        for missing in sorted({entries[name].undefined for entries in table.values()} - {0}):
            of = [f"`{m}`" for m, entries in table.items() if entries[name].undefined == missing]
            methods = "all methods" if len(of) == len(table) else ", ".join(of)
            undefined.setdefault((missing, methods), []).append(name)
    lines += [
        f"Undefined in {counted(missing, 'frame')}, left out: {', '.join(names)}: {methods}."
        for (missing, methods), names in undefined.items()
    ]
    if evaluation.bad:
        lines.append(f"{counted(evaluation.bad, 'frame')} could not be scored (bad.csv), by cause:")
        lines += list(evaluation.first_bad)
    return lines


def write_table_csv(path: Path, table: Mapping[str, Mapping[str, MetricMean]]) -> None:
    """Write table.csv: one line per method and metric, with all values."""
    numbers = ("mean", "low_95", "high_95", "frames", "undefined")
    rows = (
        (method, *(e.metric.name, e.metric.unit, e.metric.better, e.mean, e.low, e.high),
         *(e.frames, e.undefined))
        for method, entries in table.items()
        for e in entries.values()
    )  # fmt: skip
    write_csv(path, ("method", "metric", "unit", "better", *numbers), rows)


def write_bias_csv(path: Path, summary: ScoreSummary) -> None:
    """Write bias_by_distance.csv: one line per method and distance bin."""
    fields = ["method", "from_mm", "to_mm", "bias_mm", "low_95", "high_95", "pixels", "subjects"]
    rows = (
        (method, *(b.from_mm, b.from_mm + BIAS_BIN_MM, b.mean_mm, b.low_mm, b.high_mm),
         *(b.pixels, b.subjects))
        for method in summary.methods
        for b in summary.bias_by_distance(method)
    )  # fmt: skip
    write_csv(path, fields, rows)
