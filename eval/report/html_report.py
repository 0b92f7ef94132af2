"""Write report.html: tables and figures in one file that needs no network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from glsim.denoise import compose, load
from glsim.denoise.frames import Frames, Stacks
from glsim.denoise.interface import Depth
from glsim.errors import DatasetError
from glsim.eval.report.bias_table import BIAS_NOTE, BIAS_TITLE, bias_table
from glsim.eval.report.document import Document, Heading, Picture, TextTable
from glsim.eval.report.figures.bias_curves import bias_curves
from glsim.eval.report.figures.curves import disagreement, error_curves, frame_boxes
from glsim.eval.report.figures.gallery import GalleryFrame, method_gallery
from glsim.eval.report.figures.style import to_png
from glsim.eval.report.page import html_page
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
    pictures = [
        Picture(
            "disagreement",
            "All-pixel MSE and surface error: a dot per frame, a large dot for the mean of a "
            "method. Methods that keep the input's mask lie above each other, because MSE cannot "
            "tell them apart.",
            to_png(disagreement(summary)),
        ),
        Picture(
            "error_curves",
            "Cumulative absolute error on the pixels where input and truth have depth, the same "
            "for every method.",
            to_png(error_curves(summary)),
        ),
        Picture(
            "frame_boxes",
            "Distribution over frames: middle half (box), median (line), 5 to 95 % (whiskers) and "
            "mean (diamond).",
            to_png(frame_boxes(evaluation.summary)),
        ),
    ]
    over_distance = bias_curves(summary)
    if over_distance is not None:
        caption = "Bias over distance: mean error per 100 mm, with its 95 % interval over subjects."
        pictures.append(Picture("bias_by_distance", caption, to_png(over_distance)))
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
            pictures.append(Picture(f"gallery_{sheet + 1}", caption, to_png(figure)))
    for picture in pictures:
        write_atomic(picture.png, out / "figures" / f"{picture.name}.png")
    legend = (
        f"{evaluation.frames} frames of {len(evaluation.summary.subjects)} subjects. Small: the "
        "95 % interval over subjects (bootstrap). Bold: the best mean. Arrows: which way is better."
    )
    sections = [*documents, _scores(table, legend), *_further_tables(evaluation, table)]
    path = out / "report.html"
    text = html_page(heading, sections, pictures, _notes(evaluation, table))
    write_atomic(text.encode(), path)
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
                infrared = frames.infrared(number) if method.infrared else None
                denoised = method(*stacks.around(number, method.before, method.after), infrared)
            except Exception:  # any error of a user's denoiser; scoring has counted it
                continue
            for part, depth in compose(denoised, sample.noisy_mm).items():
                predictions[f"{method.label} [{part}]" if part else method.label] = depth
        return GalleryFrame(
            sample.clean_mm,
            sample.intrinsics,
            predictions,
            f"{frames.key(number)}, protocol {frames.protocol}",
            offset_mm=sample.offset_mm,
        )
    return None


def _scores(table: ResultTable, legend: str) -> Document:
    """Return the tables of all metrics, with intervals."""
    document = Document("Scores", [legend])
    for title, names in TABLE_SECTIONS.items():
        metrics = [TABLE_METRICS[name] for name in names]
        tops = {m.name: best_methods(table, m) for m in metrics}
        rows = []
        for method, entries in table.items():
            cells = [f"`{method}`"]
            for m in metrics:
                entry = entries[m.name]
                mean, low, high = (
                    format_number(number, m.unit) for number in (entry.mean, entry.low, entry.high)
                )
                best = f"**{mean}**" if method in tops[m.name] else mean
                cells.append(f"{best}\n{low} - {high}")
            rows.append(cells)
        head = ["method", *(f"{m.heading} {m.arrow}" for m in metrics)]
        document.parts += [Heading(title), TextTable(head, rows)]
    return document


def _further_tables(evaluation: Evaluation, table: ResultTable) -> Iterator[Document]:
    """Yield parts of the face, bias over distance and trivial predictions, where there are any."""
    regions = Document(REGION_TITLE, [REGION_NOTE])
    for title, head, rows in region_tables(table):
        regions.parts += [Heading(title), TextTable(head, rows)]
    if len(regions.parts) > 1:
        yield regions
    head, rows = bias_table(evaluation.summary)
    if rows:
        yield Document(BIAS_TITLE, [BIAS_NOTE, TextTable(head, rows)])
    baselines = evaluation.baselines
    if baselines.methods:
        metrics = [TABLE_METRICS[name] for name in BASELINE_METRICS]
        rows = [
            [name, *(format_number(baselines.mean(name, m.name), m.unit) for m in metrics)]
            for name in baselines.methods
        ]
        head = ["prediction", *(f"{m.heading} {m.arrow}" for m in metrics)]
        yield Document("Trivial predictions: a scale for the above", [TextTable(head, rows)])


def _notes(evaluation: Evaluation, table: ResultTable) -> Iterator[Document]:
    """Yield what follows the figures: definitions, and remarks if there are any."""
    metrics = [TABLE_METRICS[name] for names in TABLE_SECTIONS.values() for name in names]
    yield Document("Definitions", [[f"**{m.heading}**: {m.help}" for m in metrics]])
    notes = remarks(evaluation, table)
    if notes:
        yield Document("Remarks", [notes])
