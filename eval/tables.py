"""Results as tables: Markdown and LaTeX for people, CSV with everything."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from .aggregate import PSNR_OF_MEAN, Entry
from .metrics import METRICS, OF_REGION, Metric
from .run import Evaluation, write_csv

Table = dict[str, dict[str, Entry]]

#: Title -> the metrics that are shown; table.csv has all.
SHOWN: Final[dict[str, tuple[str, ...]]] = {
    "The paper's block: all pixels, holes are depth 0": (
        "mse_mm2",
        "psnr_db",
        "psnr_of_mean_db",
        "mse_flips_pct",
        "ssim_paper",
        "ssim_standard",
        "ssim_16bit",
    ),
    "Validity": ("iou", "precision", "recall", "flips_px", "flying_px"),
    "Depth and surface": (
        "both_rmse_mm",
        "input_rmse_mm",
        "both_interior_rmse_mm",
        "both_edge_rmse_mm",
        "filled_rmse_mm",
        "input_bias_mm",
        "normal_mean_deg",
        "normal_good_pct",
        "time_ms",
    ),
}
ALL: Final = {**METRICS, PSNR_OF_MEAN.name: PSNR_OF_MEAN}


def number(value: float, unit: str = "mm") -> str:
    """To four digits that mean something; shares to four places, as their differences are small."""
    if math.isnan(value):
        return "n/a"
    if unit == "1":
        return f"{value:.4f}"
    digits = max(0, min(2, 3 - math.floor(math.log10(abs(value))))) if value else 0
    return f"{value:.{digits}f}"


def best(table: Table, metric: Metric) -> set[str]:
    """The methods with the best mean, as it is printed."""
    means = {name: entries[metric.name].mean for name, entries in table.items()}
    known = {name: value for name, value in means.items() if not math.isnan(value)}
    if metric.better == "neither" or not known:
        return set()
    top = (max if metric.better == "higher" else min)(known.values())
    return {n for n, v in known.items() if number(v, metric.unit) == number(top, metric.unit)}


def markdown(evaluation: Evaluation, table: Table, heading: str) -> str:
    """table.md: the shown metrics with their intervals, probes, definitions, what is missing."""
    summary = evaluation.summary
    lines = [
        f"# {heading}",
        "",
        f"{evaluation.frames} frames of {len(summary.subjects)} subjects. In brackets the 95 % "
        "interval over subjects (bootstrap). Bold: the best mean. Arrows: which way is better.",
        "",
    ]
    for title, names in SHOWN.items():
        metrics = [ALL[name] for name in names]
        head = ["method", *(f"{m.heading} {m.arrow}".strip() for m in metrics)]
        tops = {m.name: best(table, m) for m in metrics}
        rows = [
            [f"`{method}`", *(_cell(entries[m.name], method in tops[m.name]) for m in metrics)]
            for method, entries in table.items()
        ]
        lines += [f"## {title}", "", *_grid(head, rows), ""]
    regions = region_grids(table)
    if regions:
        lines += [f"## {REGION_TITLE}", "", REGION_NOTE, ""]
        for title, head, rows in regions:
            lines += [f"**{title}**", "", *_grid(head, rows), ""]
    if evaluation.probes.methods:
        lines += [
            "## Trivial predictions, to read the numbers above",
            "",
            *_probe_grid(evaluation),
            "",
        ]
    lines += ["## Definitions", ""]
    shown = [name for names in SHOWN.values() for name in names]
    lines += [f"- **{ALL[name].heading}**: {ALL[name].help}." for name in shown]
    notes = [f"- {note}" for note in remarks(evaluation, table)]
    lines += ["", "## Remarks", "", *notes] if notes else []
    return "\n".join(lines).rstrip() + "\n"


REGION_TITLE: Final = "Parts of the face"
REGION_NOTE: Final = (
    "RMSE and bias on the pixels where input and clean are valid, off the edges, as "
    "input_interior_*; normals where normal_mean_deg has them. Parts that no frame shows there "
    "are left out; all parts are in table.csv."
)


def region_grids(table: Table) -> list[tuple[str, list[str], list[list[str]]]]:
    """(title, heads, rows) of what is known of each part of the face; none if nothing is.

    A row is a method's name and its means, one a part; the best of a part is bold.
    """
    first = next(iter(table.values()))
    grids = []
    for name in OF_REGION:
        ours = [
            m for m in (entry.metric for entry in first.values()) if m.name.startswith(f"{name}@")
        ]
        ours = [m for m in ours if any(entries[m.name].frames for entries in table.values())]
        if not ours:
            continue
        tops = {m.name: best(table, m) for m in ours}
        rows = []
        for method, entries in table.items():
            means = [(number(entries[m.name].mean, m.unit), method in tops[m.name]) for m in ours]
            rows.append([f"`{method}`", *(f"**{text}**" if top else text for text, top in means)])
        title = f"{name} [{ours[0].unit}] {ours[0].arrow}".strip()
        grids.append((title, ["method", *(m.name.partition("@")[2] for m in ours)], rows))
    return grids


def _cell(entry: Entry, top: bool) -> str:
    unit = entry.metric.unit
    mean = number(entry.mean, unit)
    text = f"**{mean}**" if top else mean
    if math.isnan(entry.low):
        return text
    return f"{text} [{number(entry.low, unit)}, {number(entry.high, unit)}]"


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    rule = "|" + "---|" * len(head)
    return [f"| {' | '.join(head)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)]


#: What is shown of trivial predictions.
PROBE_METRICS: Final = (
    "mse_mm2",
    "psnr_db",
    "ssim_paper",
    "ssim_standard",
    "iou",
    "flips_px",
    "both_rmse_mm",
    "normal_mean_deg",
)


def _probe_grid(evaluation: Evaluation) -> list[str]:
    probes = evaluation.probes
    metrics = [METRICS[name] for name in PROBE_METRICS]
    rows = [
        [probe, *(number(probes.mean(probe, m.name), m.unit) for m in metrics)]
        for probe in probes.methods
    ]
    return _grid(["prediction", *(f"{m.heading} {m.arrow}" for m in metrics)], rows)


def remarks(evaluation: Evaluation, table: Table) -> list[str]:
    """Sentences on what the means leave out, and on frames that could not be scored."""
    undefined: dict[str, list[str]] = {}
    for method, entries in table.items():
        for name in (name for names in SHOWN.values() for name in names):
            if missing := entries[name].undefined:
                what = f"{name} is undefined in {missing} frames, which its mean leaves out"
                undefined.setdefault(what, []).append(f"`{method}`")
    lines = [f"{what}: {', '.join(methods)}." for what, methods in undefined.items()]
    if evaluation.bad:
        lines.append(f"{evaluation.bad} frames could not be scored (bad.csv), the first of them:")
        lines += list(evaluation.first_bad)
    return lines


def write_table_csv(path: Path, table: Table) -> None:
    """table.csv: one line a method and metric, everything that is known."""
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


def latex(table: Table) -> str:
    """table.tex: a booktabs tabular of the most telling columns."""
    arrows = {"lower": r"$\downarrow$", "higher": r"$\uparrow$", "neither": ""}
    metrics = [METRICS[name] for name in _LATEX_METRICS]
    tops = {m.name: best(table, m) for m in metrics}
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
            text = number(entries[m.name].mean, m.unit)
            cells.append(rf"\textbf{{{text}}}" if method in tops[m.name] else text)
        lines.append(rf"{_escaped(method)} & {' & '.join(cells)} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _escaped(text: str) -> str:
    for special in "_%&#$":
        text = text.replace(special, f"\\{special}")
    return rf"\texttt{{{text}}}"
