"""Result tables: Markdown and LaTeX for people, CSV with all values."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from glsim.depth_protocol import MEANING
from glsim.eval.metrics.metric import GROUPS, Metric
from glsim.eval.metrics.regions import REGION_METRICS
from glsim.eval.metrics.score import METRICS
from glsim.eval.report.bias_table import BIAS_NOTE, BIAS_TITLE, bias_table
from glsim.eval.scoring.aggregate import PSNR_OF_MEAN, MetricMean
from glsim.eval.scoring.run import Evaluation, write_csv
from glsim.files.markdown import markdown_table

#: Method -> metric -> mean over the set.
ResultTable = dict[str, dict[str, MetricMean]]

TABLE_METRICS: Final = {**METRICS, PSNR_OF_MEAN.name: PSNR_OF_MEAN}
#: Sections of table.md: title -> metrics; table.csv has all metrics.
TABLE_SECTIONS: Final[dict[str, list[str]]] = {
    title: [m.name for m in TABLE_METRICS.values() if m.in_table and GROUPS[m.group] == title]
    for title in dict.fromkeys(GROUPS.values())
}


def format_number(value: float, unit: str = "mm") -> str:
    """Format a value with about four digits; shares (unit "1") with four decimals."""
    if math.isnan(value):
        return "n/a"
    if unit == "1":
        return f"{value:.4f}"
    digits = max(0, min(2, 3 - math.floor(math.log10(abs(value))))) if value else 0
    return f"{value:.{digits}f}"


def best_methods(table: ResultTable, metric: Metric) -> set[str]:
    """Return the methods with the best mean, compared as printed."""
    means = {name: entries[metric.name].mean for name, entries in table.items()}
    known = {name: value for name, value in means.items() if not math.isnan(value)}
    if metric.better == "neither" or not known:
        return set()
    top = (max if metric.better == "higher" else min)(known.values())
    return {
        n
        for n, v in known.items()
        if format_number(v, metric.unit) == format_number(top, metric.unit)
    }


def table_markdown(evaluation: Evaluation, table: ResultTable, heading: str) -> str:
    """Return table.md: means with intervals, trivial baselines, definitions, remarks."""
    summary = evaluation.summary
    lines = [
        f"# {heading}",
        "",
        f"{evaluation.frames} frames of {len(summary.subjects)} subjects. In brackets the 95 % "
        "interval over subjects (bootstrap). Bold: the best mean. Arrows: which way is better.",
        "",
        f"Protocol {evaluation.protocol}: {MEANING[evaluation.protocol]}.",
        "",
    ]
    for title, names in TABLE_SECTIONS.items():
        metrics = [TABLE_METRICS[name] for name in names]
        head = ["method", *(f"{m.heading} {m.arrow}".strip() for m in metrics)]
        tops = {m.name: best_methods(table, m) for m in metrics}
        rows = [
            [f"`{method}`", *(_cell(entries[m.name], method in tops[m.name]) for m in metrics)]
            for method, entries in table.items()
        ]
        lines += [f"## {title}", "", *markdown_table(head, rows), ""]
    regions = region_tables(table)
    if regions:
        lines += [f"## {REGION_TITLE}", "", REGION_NOTE, ""]
        for title, head, rows in regions:
            lines += [f"**{title}**", "", *markdown_table(head, rows), ""]
    head, rows = bias_table(summary)
    if rows:
        lines += [f"## {BIAS_TITLE}", "", BIAS_NOTE, "", *markdown_table(head, rows), ""]
    if evaluation.baselines.methods:
        lines += [
            "## Trivial predictions: a scale for the above",
            "",
            *_baseline_table(evaluation),
            "",
        ]
    lines += ["## Definitions", ""]
    shown = [name for names in TABLE_SECTIONS.values() for name in names]
    lines += [f"- **{TABLE_METRICS[name].heading}**: {TABLE_METRICS[name].help}." for name in shown]
    notes = [f"- {note}" for note in remarks(evaluation, table)]
    lines += ["", "## Remarks", "", *notes] if notes else []
    return "\n".join(lines).rstrip() + "\n"


REGION_TITLE: Final = "Parts of the face"
REGION_NOTE: Final = (
    "RMSE and bias are over the pixels of input_interior_* (input and clean valid, no edge), "
    "normals over those of normal_mean_deg. Parts without such pixels in any frame are left out; "
    "table.csv has all parts."
)


def region_tables(table: ResultTable) -> list[tuple[str, list[str], list[list[str]]]]:
    """Return (title, head, rows) of each region metric with values, none without regions.

    A row is a method and its mean per region; the best mean of a region is bold.
    """
    first = next(iter(table.values()))
    tables = []
    for name in REGION_METRICS:
        metrics = [
            m for m in (entry.metric for entry in first.values()) if m.name.startswith(f"{name}@")
        ]
        metrics = [m for m in metrics if any(entries[m.name].frames for entries in table.values())]
        if not metrics:
            continue
        tops = {m.name: best_methods(table, m) for m in metrics}
        rows = []
        for method, entries in table.items():
            means = [
                (format_number(entries[m.name].mean, m.unit), method in tops[m.name])
                for m in metrics
            ]
            rows.append([f"`{method}`", *(f"**{text}**" if top else text for text, top in means)])
        title = f"{name} [{metrics[0].unit}] {metrics[0].arrow}".strip()
        tables.append((title, ["method", *(m.name.partition("@")[2] for m in metrics)], rows))
    return tables


def _cell(entry: MetricMean, top: bool) -> str:
    unit = entry.metric.unit
    mean = format_number(entry.mean, unit)
    text = f"**{mean}**" if top else mean
    if math.isnan(entry.low):
        return text
    return f"{text} [{format_number(entry.low, unit)}, {format_number(entry.high, unit)}]"


#: The metrics of trivial baselines in tables.
BASELINE_METRICS: Final = (
    "mse_mm2",
    "psnr_db",
    "ssim_paper",
    "ssim_standard",
    "iou",
    "flips_px",
    "both_rmse_mm",
    "normal_mean_deg",
)


def _baseline_table(evaluation: Evaluation) -> list[str]:
    baselines = evaluation.baselines
    metrics = [METRICS[name] for name in BASELINE_METRICS]
    rows = [
        [name, *(format_number(baselines.mean(name, m.name), m.unit) for m in metrics)]
        for name in baselines.methods
    ]
    return markdown_table(["prediction", *(f"{m.heading} {m.arrow}" for m in metrics)], rows)


def remarks(evaluation: Evaluation, table: ResultTable) -> list[str]:
    """Return remarks: frames that a mean leaves out, and frames that could not be scored."""
    undefined: dict[str, list[str]] = {}
    for method, entries in table.items():
        for name in (name for names in TABLE_SECTIONS.values() for name in names):
            if missing := entries[name].undefined:
                remark = f"{name} is undefined in {missing} frames, which its mean leaves out"
                undefined.setdefault(remark, []).append(f"`{method}`")
    lines = [f"{remark}: {', '.join(methods)}." for remark, methods in undefined.items()]
    if evaluation.bad:
        lines.append(f"{evaluation.bad} frames could not be scored (bad.csv), the first of them:")
        lines += list(evaluation.first_bad)
    return lines


def write_table_csv(path: Path, table: ResultTable) -> None:
    """Write table.csv: one line per method and metric, with all values."""
    first = next(iter(table))
    fields = (
        *("method", "metric", "unit", "better", "mean", "low_95", "high_95", "frames"),
        *("undefined", f"p_vs_{first}", "p_holm"),
    )
    rows = (
        dict(
            zip(
                fields,
                (
                    method, e.metric.name, e.metric.unit, e.metric.better, e.mean, e.low, e.high,
                    e.frames, e.undefined, e.p, e.p_holm,
                ),
                strict=True,
            )
        )
        for method, entries in table.items()
        for e in entries.values()
    )  # fmt: skip
    write_csv(path, fields, rows)


_LATEX_METRICS: Final = (
    "mse_mm2",
    "psnr_db",
    "ssim_standard",
    "iou",
    "flying_px",
    "input_rmse_mm",
    "both_interior_rmse_mm",
    "normal_mean_deg",
)
_LATEX_HEADS: Final = {
    "mse_mm2": r"MSE [mm$^2$]",
    "psnr_db": "PSNR [dB]",
    "ssim_standard": "SSIM",
    "iou": "IoU",
    "flying_px": "flying [px]",
    "input_rmse_mm": "RMSE [mm]",
    "both_interior_rmse_mm": "interior [mm]",
    "normal_mean_deg": r"normals [$^\circ$]",
}


def table_latex(table: ResultTable) -> str:
    """Return table.tex: a booktabs tabular of the main metrics."""
    arrows = {"lower": r"$\downarrow$", "higher": r"$\uparrow$", "neither": ""}
    metrics = [METRICS[name] for name in _LATEX_METRICS]
    tops = {m.name: best_methods(table, m) for m in metrics}
    heads = " & ".join(f"{_LATEX_HEADS[m.name]} {arrows[m.better]}" for m in metrics)
    lines = [
        r"% \usepackage{booktabs}",
        rf"\begin{{tabular}}{{l{'r' * len(metrics)}}}",
        r"\toprule",
        rf"Method & {heads} \\",
        r"\midrule",
    ]
    for method, entries in table.items():
        cells = []
        for m in metrics:
            text = format_number(entries[m.name].mean, m.unit)
            cells.append(rf"\textbf{{{text}}}" if method in tops[m.name] else text)
        lines.append(rf"{_escaped(method)} & {' & '.join(cells)} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _escaped(text: str) -> str:
    for special in "_%&#$":
        text = text.replace(special, f"\\{special}")
    return rf"\texttt{{{text}}}"
