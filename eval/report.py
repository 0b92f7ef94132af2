"""report.html: one file with tables and figures that opens without a network."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from glsim.dataset.files import write_bytes
from glsim.errors import DatasetError

from .blocks import Scoring
from .denoisers import compose, load
from .figures import to_png
from .figures.curves import disagreement, error_curves, frame_boxes
from .figures.gallery import Shown, gallery
from .frames import Frames, Stacks
from .page import Page
from .run import Evaluation
from .tables import (
    ALL,
    PROBE_METRICS,
    REGION_NOTE,
    REGION_TITLE,
    SHOWN,
    Table,
    best,
    number,
    region_grids,
    remarks,
)
from .types import Depth

#: Methods beside each other in one figure; a page of a paper holds no more.
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
    table: Table,
    job: Scoring,
    out: Path,
    heading: str,
    pages: Sequence[Page] = (),
    drawn: Sequence[str] | None = None,
) -> Path:
    """Draw the figures to ``out``/figures as PNG files, and report.html with all in it.

    pages: stand before the tables. drawn: of the job's denoisers, those in figures; default: all.
    """
    job = job if drawn is None else replace(job, denoisers=tuple(drawn))
    labels = {spec.partition("@")[0] for spec in job.denoisers}
    summary = evaluation.summary.only(labels)
    pictures: list[tuple[str, str, bytes]] = [
        (
            "disagreement",
            "All-pixel MSE against what the surface is off: a dot a frame, a large one for a "
            "method's mean. Methods that share an input mask stand above each other: MSE cannot "
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
            "Frame by frame: the middle half of the frames with the median, 5 to 95 % of them, and "
            "the mean (diamond).",
            to_png(frame_boxes(evaluation.summary)),
        ),
    ]
    shown = example(job)
    if shown is not None:
        names = list(shown.predictions)
        sheets = -(-len(names) // _COLUMNS)
        for sheet in range(sheets):
            # Spread evenly, so that no page has a single column.
            first, last = (len(names) * edge // sheets for edge in (sheet, sheet + 1))
            part = {name: shown.predictions[name] for name in names[first:last]}
            figure = gallery(Shown(shown.clean, shown.intrinsics, part, shown.caption))
            caption = "One frame, every method in the same scale."
            pictures.append((f"gallery_{sheet + 1}", caption, to_png(figure)))
    for name, _, png in pictures:
        write_bytes(png, out / "figures" / f"{name}.png")
    path = out / "report.html"
    write_bytes(_page(evaluation, table, heading, pictures, pages).encode(), path)
    return path


def example(job: Scoring) -> Shown | None:
    """The frame in the middle of the set by every method; None if none there can be read."""
    frames: Frames = job.frames()
    methods = [load(spec) for spec in job.denoisers]
    before = max((method.before for method in methods), default=0)
    after = max((method.after for method in methods), default=0)
    stacks = Stacks(frames, before, after)
    middle = len(frames) // 2
    for number_ in range(middle, len(frames)):
        try:
            sample = stacks.sample(number_)
        except DatasetError:
            continue
        predictions: dict[str, Depth] = {}
        for method in methods:
            try:
                denoised = method(*stacks.around(number_, method.before, method.after))
            except Exception:  # of any kind, as users bring denoisers: counted where it was scored
                continue
            for part, depth in compose(denoised, sample.noisy_mm).items():
                predictions[f"{method.label} [{part}]" if part else method.label] = depth
        return Shown(sample.clean_mm, sample.intrinsics, predictions, str(frames.key(number_)))
    return None


def _page(
    evaluation: Evaluation,
    table: Table,
    heading: str,
    pictures: Sequence[tuple[str, str, bytes]],
    pages: Sequence[Page],
) -> str:
    body = [
        f"<h1>{html.escape(heading)}</h1>",
        f"<p>{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects. Small: the "
        "95 % interval over subjects (bootstrap). Bold: the best mean. Arrows: which way is "
        "better.</p>",
    ]
    body += [page.html() for page in pages]
    for title, names in SHOWN.items():
        metrics = [ALL[name] for name in names]
        head = ["method", *(f"{m.heading} {m.arrow}" for m in metrics)]
        tops = {m.name: best(table, m) for m in metrics}
        rows: list[list[str]] = []
        for method, entries in table.items():
            cells = [f"<code>{html.escape(method)}</code>"]
            for m in metrics:
                entry = entries[m.name]
                mean = number(entry.mean, m.unit)
                cell = f"<b>{mean}</b>" if method in tops[m.name] else mean
                low, high = number(entry.low, m.unit), number(entry.high, m.unit)
                cells.append(f"{cell}<small>{low} - {high}</small>")
            rows.append(cells)
        body += [f"<h2>{html.escape(title)}</h2>", _html_table(head, rows)]
    regions = region_grids(table)
    if regions:
        body += [f"<h2>{REGION_TITLE}</h2>", f"<p>{REGION_NOTE}</p>"]
    for title, head, rows in regions:
        body += [
            f"<h3>{title}</h3>",
            _html_table(head, [[_html(cell) for cell in r] for r in rows]),
        ]
    probes = evaluation.probes
    if probes.methods:
        metrics = [ALL[name] for name in PROBE_METRICS]
        rows = [
            [html.escape(name), *(number(probes.mean(name, m.name), m.unit) for m in metrics)]
            for name in probes.methods
        ]
        head = ["prediction", *(f"{m.heading} {m.arrow}" for m in metrics)]
        body += ["<h2>Trivial predictions, to read the numbers above</h2>", _html_table(head, rows)]
    body.append("<h2>Figures</h2>")
    for name, caption, png in pictures:
        data = base64.b64encode(png).decode()
        body.append(
            f'<figure id="{name}"><img alt="{html.escape(caption)}" '
            f'src="data:image/png;base64,{data}"><figcaption>{html.escape(caption)}</figcaption>'
            "</figure>"
        )
    body.append("<h2>Definitions</h2><dl>")
    for names in SHOWN.values():
        body += [
            f"<dt><b>{html.escape(ALL[name].heading)}</b></dt><dd>{html.escape(ALL[name].help)}</dd>"
            for name in names
        ]
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
    """A cell of Markdown: bold, code, or plain."""
    for mark, tag in (("**", "b"), ("`", "code")):
        if cell.startswith(mark):
            return f"<{tag}>{html.escape(cell.strip(mark))}</{tag}>"
    return html.escape(cell)


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells are HTML already, heads are not."""
    top = "".join(f"<th>{html.escape(text)}</th>" for text in head)
    lines = ["".join(f"<td>{cell}</td>" for cell in row) for row in rows]
    inner = "".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table><tr>{top}</tr>{inner}</table></div>'
