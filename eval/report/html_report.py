"""Write report.html: tables and figures in one file that needs no network."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from glsim.denoise import compose, load
from glsim.denoise.frames import Frames, Stacks
from glsim.denoise.protocol import Depth
from glsim.errors import DatasetError
from glsim.eval.report.bias_table import BIAS_NOTE, BIAS_TITLE, bias_table
from glsim.eval.report.document import Document
from glsim.eval.report.figures.bias_curves import bias_curves
from glsim.eval.report.figures.curves import disagreement, error_curves, frame_boxes
from glsim.eval.report.figures.gallery import GalleryFrame, method_gallery
from glsim.eval.report.figures.style import to_png
from glsim.eval.report.tables import (
    BASELINE_METRICS,
    REGION_NOTE,
    REGION_TITLE,
    TABLE_METRICS,
    TABLE_SECTIONS,
    ResultTable,
    best_methods,
    format_number,
    region_tables,
    remarks,
)
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.run import Evaluation
from glsim.files.atomic import write_atomic

#: Largest number of methods side by side in a figure, which is as wide as a paper page.
_COLUMNS: Final = 5

_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem;
       color: #1a1a1a; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
td small { color: #777; display: block; white-space: nowrap; }
.wide { overflow-x: auto; }
figure { margin: 1.5rem 0; } figcaption { color: #555; font-size: 13px; }
img { max-width: 100%; }
"""


def write_report(
    evaluation: Evaluation,
    table: ResultTable,
    job: ScoringJob,
    out: Path,
    heading: str,
    documents: Sequence[Document] = (),
    drawn: Sequence[str] | None = None,
) -> Path:
    """Write the figures as PNG files to ``out``/figures, and report.html; return its path.

    documents: sections before the tables. drawn: the denoisers of the job that figures show;
    default: all.
    """
    job = job if drawn is None else replace(job, denoisers=tuple(drawn))
    labels = {spec.partition("@")[0] for spec in job.denoisers}
    summary = evaluation.summary.only(labels)
    pictures: list[tuple[str, str, bytes]] = [
        (
            "disagreement",
            "All-pixel MSE and surface error: a dot per frame, a large dot for the mean of a "
            "method. Methods that keep the input's mask lie above each other, because MSE cannot "
            "tell them apart.",
            to_png(disagreement(summary)),
        ),
        (
            "error_curves",
            "Cumulative absolute error on the pixels where input and truth have depth, the same "
            "for every method.",
            to_png(error_curves(summary)),
        ),
        (
            "frame_boxes",
            "Distribution over frames: middle half (box), median (line), 5 to 95 % (whiskers) and "
            "mean (diamond).",
            to_png(frame_boxes(evaluation.summary)),
        ),
    ]
    over_distance = bias_curves(summary)
    if over_distance is not None:
        caption = "Bias over distance: mean error per 100 mm, with its 95 % interval over subjects."
        pictures.append(("bias_by_distance", caption, to_png(over_distance)))
    frame = example_frame(job)
    if frame is not None:
        names = list(frame.predictions)
        sheets = -(-len(names) // _COLUMNS)
        for sheet in range(sheets):
            # Methods are spread evenly, so that no figure has a single column.
            first, last = (len(names) * edge // sheets for edge in (sheet, sheet + 1))
            part = {name: frame.predictions[name] for name in names[first:last]}
            figure = method_gallery(replace(frame, predictions=part))
            caption = "One frame denoised by every method, in the same scale."
            pictures.append((f"gallery_{sheet + 1}", caption, to_png(figure)))
    for name, _, png in pictures:
        write_atomic(png, out / "figures" / f"{name}.png")
    path = out / "report.html"
    write_atomic(_html_text(evaluation, table, heading, pictures, documents).encode(), path)
    return path


def example_frame(job: ScoringJob) -> GalleryFrame | None:
    """Denoise the frame in the middle of the set by every method.

    Takes the next readable frame; returns None if there is none.
    """
    frames: Frames = job.frames()
    methods = [load(spec) for spec in job.denoisers]
    before = max((method.before for method in methods), default=0)
    after = max((method.after for method in methods), default=0)
    stacks = Stacks(frames, before, after)
    middle = len(frames) // 2
    for number in range(middle, len(frames)):
        try:
            sample = stacks.sample(number)
        except DatasetError:
            continue
        predictions: dict[str, Depth] = {}
        for method in methods:
            try:
                denoised = method(*stacks.around(number, method.before, method.after))
            except Exception:  # any error of a user's denoiser; scoring has counted it
                continue
            for part, depth in compose(denoised, sample.noisy_mm).items():
                predictions[f"{method.label} [{part}]" if part else method.label] = depth
        return GalleryFrame(
            sample.clean_mm, sample.intrinsics, predictions, str(frames.key(number))
        )
    return None


def _html_text(
    evaluation: Evaluation,
    table: ResultTable,
    heading: str,
    pictures: Sequence[tuple[str, str, bytes]],
    documents: Sequence[Document],
) -> str:
    body = [
        f"<h1>{html.escape(heading)}</h1>",
        f"<p>{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects. Small: the "
        "95 % interval over subjects (bootstrap). Bold: the best mean. Arrows: which way is "
        "better.</p>",
    ]
    body += [document.html() for document in documents]
    for title, names in TABLE_SECTIONS.items():
        metrics = [TABLE_METRICS[name] for name in names]
        head = ["method", *(f"{m.heading} {m.arrow}" for m in metrics)]
        tops = {m.name: best_methods(table, m) for m in metrics}
        rows: list[list[str]] = []
        for method, entries in table.items():
            cells = [f"<code>{html.escape(method)}</code>"]
            for m in metrics:
                entry = entries[m.name]
                mean = format_number(entry.mean, m.unit)
                cell = f"<b>{mean}</b>" if method in tops[m.name] else mean
                low, high = format_number(entry.low, m.unit), format_number(entry.high, m.unit)
                cells.append(f"{cell}<small>{low} - {high}</small>")
            rows.append(cells)
        body += [f"<h2>{html.escape(title)}</h2>", _html_table(head, rows)]
    regions = region_tables(table)
    if regions:
        body += [f"<h2>{REGION_TITLE}</h2>", f"<p>{REGION_NOTE}</p>"]
    for title, head, rows in regions:
        body += [
            f"<h3>{title}</h3>",
            _html_table(head, [[_html(cell) for cell in r] for r in rows]),
        ]
    head, rows = bias_table(evaluation.summary)
    if rows:
        body += [f"<h2>{BIAS_TITLE}</h2>", f"<p>{html.escape(BIAS_NOTE)}</p>"]
        body.append(_html_table(head, [[_html(cell) for cell in r] for r in rows]))
    baselines = evaluation.baselines
    if baselines.methods:
        metrics = [TABLE_METRICS[name] for name in BASELINE_METRICS]
        rows = [
            [
                html.escape(name),
                *(format_number(baselines.mean(name, m.name), m.unit) for m in metrics),
            ]
            for name in baselines.methods
        ]
        head = ["prediction", *(f"{m.heading} {m.arrow}" for m in metrics)]
        body += ["<h2>Trivial predictions: a scale for the above</h2>", _html_table(head, rows)]
    body.append("<h2>Figures</h2>")
    for name, caption, png in pictures:
        data = base64.b64encode(png).decode()
        body.append(
            f'<figure id="{name}"><img alt="{html.escape(caption)}" '
            f'src="data:image/png;base64,{data}"><figcaption>{html.escape(caption)}</figcaption>'
            "</figure>"
        )
    body.append("<h2>Definitions</h2><dl>")
    for metric in (TABLE_METRICS[name] for names in TABLE_SECTIONS.values() for name in names):
        name, definition = html.escape(metric.heading), html.escape(metric.help)
        body.append(f"<dt><b>{name}</b></dt><dd>{definition}</dd>")
    body.append("</dl>")
    notes: list[Any] = remarks(evaluation, table)
    if notes:
        body.append("<h2>Remarks</h2><ul>")
        body += [f"<li>{html.escape(note)}</li>" for note in notes]
        body.append("</ul>")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(heading)}'
        f"</title><style>{_STYLE}</style></head><body>{''.join(body)}</body></html>\n"
    )


def _html(cell: str) -> str:
    """Convert a Markdown cell to HTML: bold, code, or plain."""
    for mark, tag in (("**", "b"), ("`", "code")):
        if cell.startswith(mark):
            return f"<{tag}>{html.escape(cell.strip(mark))}</{tag}>"
    return html.escape(cell)


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an HTML table. Cells are HTML already; heads are plain text."""
    top = "".join(f"<th>{html.escape(text)}</th>" for text in head)
    lines = ["".join(f"<td>{cell}</td>" for cell in row) for row in rows]
    inner = "".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table><tr>{top}</tr>{inner}</table></div>'
