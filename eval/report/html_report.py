"""Write report.html: tables and figures in one file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from glsim.denoise import load_denoiser
from glsim.denoise.frames import Frames, Stacks
from glsim.denoise.interface import Depth
from glsim.errors import DatasetError
from glsim.eval.report.document import CaptionedPng, Document
from glsim.eval.report.figures.bias_curves import bias_curves
from glsim.eval.report.figures.curves import disagreement, error_curves, frame_boxes
from glsim.eval.report.figures.gallery import GalleryFrame, method_gallery
from glsim.eval.report.figures.style import to_png
from glsim.eval.report.page import html_page
from glsim.eval.report.tables import ResultTable, note_documents, result_documents
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
    """Write report.html, and its figures as PNG files to ``out``/figures.

    Args:
        evaluation: the scores.
        table: method -> metric -> mean.
        job: what was scored.
        out: folder.
        heading: title of the page.
        documents: sections before the tables.
        drawn: denoisers of the job that figures show; default: all.

    Returns:
        The path of report.html.

    """
    job = job if drawn is None else replace(job, denoisers=tuple(drawn))
    labels = {spec.partition("@")[0] for spec in job.denoisers}
    summary = evaluation.summary.only(labels)
    pictures = [
        CaptionedPng(
            "disagreement",
            "All-pixel MSE and surface error: a dot per frame, a large dot for the mean of a "
            "method. Methods that keep the input's mask lie above each other, because MSE cannot "
            "tell them apart.",
            to_png(disagreement(summary)),
        ),
        CaptionedPng(
            "error_curves",
            "Cumulative absolute error on the pixels where input and truth have depth, the same "
            "for every method.",
            to_png(error_curves(summary)),
        ),
        CaptionedPng(
            "frame_boxes",
            "Distribution over frames: middle half (box), median (line), 5 to 95 % (whiskers) and "
            "mean (diamond).",
            to_png(frame_boxes(evaluation.summary)),
        ),
    ]
    over_distance = bias_curves(summary)
    if over_distance is not None:
        caption = "Bias over distance: mean error per 100 mm, with its 95 % interval over subjects."
        pictures.append(CaptionedPng("bias_by_distance", caption, to_png(over_distance)))
    frame = example_frame(job)
    if frame is not None:
        names = [name for name in frame.predictions if name in summary.methods]
        sheets = -(-len(names) // _COLUMNS)
        for sheet in range(sheets):
            # Methods are spread evenly, so that no figure has a single column.
            first, last = (len(names) * edge // sheets for edge in (sheet, sheet + 1))
            part = {name: frame.predictions[name] for name in names[first:last]}
            figure = method_gallery(replace(frame, predictions=part))
            caption = "One frame denoised by every method, in the same scale."
            pictures.append(CaptionedPng(f"gallery_{sheet + 1}", caption, to_png(figure)))
    for picture in pictures:
        write_atomic(picture.png, out / "figures" / f"{picture.name}.png")
    path = out / "report.html"
    sections = [*documents, *result_documents(evaluation, table)]
    text = html_page(heading, sections, pictures, note_documents(evaluation, table))
    write_atomic(text.encode(), path)
    return path


def example_frame(job: ScoringJob) -> GalleryFrame | None:
    """Denoise the frame in the middle of the set by every method.

    Takes the next readable frame; returns None if there is none.
    """
    frames: Frames = job.frames()
    methods = [load_denoiser(spec) for spec in job.denoisers]
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
                stack, now = stacks.around(number, method.before, method.after)
                estimate = method.estimate(stack, now, infrared)
            except Exception:  # of a denoiser; scoring has counted it
                continue
            for part, depth in estimate.composites().items():
                predictions[f"{method.label} [{part}]" if part else method.label] = depth
        return GalleryFrame(
            sample.clean_mm,
            sample.intrinsics,
            predictions,
            f"{frames.key(number)}, protocol {frames.protocol}",
            offset_mm=sample.offset_mm,
        )
    return None
