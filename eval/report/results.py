"""Output of an evaluation: tables, CSV files, and report.html with figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from glsim.core.array_types import Depth
from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import DatasetError
from glsim.core.files.atomic import write_atomic
from glsim.denoise.registry import load_denoiser
from glsim.eval.report.document import CaptionedPng, Document, html_page
from glsim.eval.report.figures.curves import bias_curves
from glsim.eval.report.figures.panels import PANEL_ROWS, method_panels
from glsim.eval.report.figures.style import to_png
from glsim.eval.report.score_tables import (
    ResultTable,
    in_order,
    note_documents,
    result_documents,
    table_markdown,
    write_bias_csv,
    write_table_csv,
)
from glsim.eval.scoring.blocks import ScoringJob, denoise, stacks_of
from glsim.eval.scoring.evaluate import Evaluation

#: Largest number of methods beside each other in a figure, which is as wide as a printed page.
_COLUMNS: Final = 5


def write_results(
    evaluation: Evaluation, table: ResultTable, job: ScoringJob, out: Path,
    pages: Mapping[str, Document] | None = None, drawn: Sequence[str] | None = None,
) -> list[Path]:  # fmt: skip
    """Write table.md and .tex, the CSV files, further pages and, with figures, report.html.

    Tables and figures show the default composite of a network; table.csv has all composites.
    Returns the written files.

    ``pages``: file name without .md -> page, first in report.html. ``drawn``: denoisers of the job
    that figures show; None: neither figures nor report.html.
    """
    heading = f"{job.dataset.name}, {job.split}, protocol {evaluation.protocol}"
    if job.truth != "clean":
        heading += f", compared with the {job.truth} depth"
    shown = replace(evaluation, summary=evaluation.summary.one_composite())
    shown_table = {method: table[method] for method in shown.summary.methods}
    texts = {
        "table.md": table_markdown(shown, shown_table, heading),
        "table.tex": "\n".join(d.latex() for d in result_documents(shown, shown_table)),
    }
    for stem, document in (pages or {}).items():
        texts |= {f"{stem}.md": document.markdown(), f"{stem}.tex": document.latex()}
    for name, text in texts.items():
        write_atomic(text.encode(), out / name)
    write_table_csv(out / "table.csv", table)
    if evaluation.baselines.methods:
        write_table_csv(out / "baselines.csv", evaluation.baselines.table())
    write_bias_csv(out / "bias_by_distance.csv", evaluation.summary)
    names = ["rows.csv", "table.csv", "bias_by_distance.csv", *texts]
    if drawn is not None:
        pictures = _pictures(shown, replace(job, denoisers=tuple(drawn)))
        for picture in pictures:
            write_atomic(picture.png, out / "figures" / f"{picture.name}.png")
        sections = [*(pages or {}).values(), *result_documents(shown, shown_table)]
        page = html_page(heading, sections, pictures, note_documents(shown, shown_table))
        write_atomic(page.encode(), out / "report.html")
        names.append("report.html")
    return [out / name for name in names]


def _pictures(evaluation: Evaluation, job: ScoringJob) -> list[CaptionedPng]:
    summary = evaluation.summary.only({spec.partition("@")[0] for spec in job.denoisers})
    pictures = []
    if (over_distance := bias_curves(summary)) is not None:
        caption = "Bias over distance: mean error per 100 mm, with its 95 % interval over subjects."
        pictures.append(CaptionedPng("bias_by_distance", caption, to_png(over_distance)))
    example = example_frame(job)
    if example is not None:
        frame, maps, title = example
        names = in_order(summary, [name for name in maps if name in summary.methods], job.tuned)
        sheets = max(1, -(-len(names) // _COLUMNS))
        for sheet in range(sheets):
            # Methods are spread evenly, so that no figure has a single column.
            first, last = (len(names) * edge // sheets for edge in (sheet, sheet + 1))
            titled = {
                name.replace(":", "\n", 1).replace(" [", "\n[", 1): maps[name]
                for name in names[first:last]
            }
            figure = method_panels(frame, titled, PANEL_ROWS, title)
            shown = title.partition(",")[0]
            caption = f"One frame, {shown}, in one scale; errors: red is too far, blue too near."
            if sheet == 0:
                caption += " Truth, input, the best inside, the best filter, others; tuned last."
            pictures.append(CaptionedPng(f"gallery_{sheet + 1}", caption, to_png(figure)))
    return pictures


def example_frame(job: ScoringJob) -> tuple[DepthFrame, dict[str, Depth], str] | None:
    """Denoise the middle frame of the set, or the next readable frame, by every method.

    Returns the frame, label -> map, and a title that names failing methods; None without a frame.
    """
    frames = job.frames()
    methods = [load_denoiser(spec) for spec in job.denoisers]
    stacks = stacks_of(frames, methods)
    for number in range(len(frames) // 2, len(frames)):
        try:
            frame = stacks.frame(number)
        except DatasetError:
            continue
        maps: dict[str, Depth] = {}
        title = f"{number + 1} of {len(frames)}: {frame.key}, protocol {frames.protocol}"
        for method in methods:
            try:
                maps |= denoise(method, stacks, number)[0]
            except Exception:  # a denoiser may raise any error; scoring counted it
                title += f"; {method.label} fails"
        return frame, maps, title
    return None
