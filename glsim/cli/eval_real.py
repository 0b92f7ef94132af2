"""``glsim eval-real``: score denoisers on real recordings, which have no clean truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli import eval as cli_eval
from glsim.cli.common import JsonOption, print_json, print_message, print_table, print_written
from glsim.cli.progress import frame_progress
from glsim.core.errors import ConfigError

if TYPE_CHECKING:
    from glsim.eval.real_frames.totals import RealScores


def evaluate_real(
    recording: Path,
    denoiser: cli_eval.DenoisersOption = None,
    out: cli_eval.OutOption = Path("scores"),
    tune_filters: Annotated[bool, typer.Option("--tune-filters")] = False,
    board: str = "5x7",
    figures: bool = True,
    workers: str = "auto",
    focal_px: Annotated[float | None, typer.Option(min=1)] = None,
    depth_unit_mm: float | None = None,
    topic: str | None = None,
    as_json: JsonOption = False,
) -> None:
    """Score denoisers on frames of a camera, which have no clean truth.

    Measures static pairs, a chessboard's plane, the shift of surfaces, losses and fills at edges.
    Without --denoiser the shipped network is scored.

    Args:
        recording: Frames of a real camera: a folder, a file, a bag, ...
        tune_filters: Add the classical filters, tuned on the static pairs of one half.
        board: Inner corners of the chessboard.
    """
    from glsim.data.worker_processes import worker_count
    from glsim.eval.real_frames.halves import Source, split_recording
    from glsim.eval.real_frames.score_recording import score_recording, tune_on_pairs
    from glsim.eval.report.real_frames_page import write_real_frames
    from glsim.eval.scoring.evaluate import check_owner

    opened = split_recording(Source(recording, focal_px, _pattern(board), depth_unit_mm, topic))
    check_owner(out, str(recording.absolute()))
    specs = list(denoiser or ["face"])
    figures = cli_eval.figures_wanted(figures)
    count = worker_count(workers)
    remarks = list(filter(None, [opened.recording.sentence(focal_px, real=True)]))
    for remark in remarks:
        print_message(remark)
    if tune_filters:
        with frame_progress("tuning") as progress:
            tuned, _ = tune_on_pairs(opened, workers=count, progress=progress)
        specs = list(dict.fromkeys([*tuned, *specs]))
        half = "scenes" if opened.by_scene else "tiles of 64 x 64 px, as a chessboard"
        print_message(f"tuned on half of the {half}: {' '.join(tuned)}")
        remarks.append(
            f"Filters with settings are tuned on the static pairs of one half of the {half}; "
            "static pairs of all methods are scored on the other half."
        )
    if len(opened.partner) == 0:
        remarks.append("No two frames show one static view: there are no static pairs.")
        print_message(f"{remarks[-1]} n/a: the frames lack what this measure needs")
    with frame_progress("scoring") as progress:
        scores = score_recording(
            opened, specs, scoring_half=tune_filters, workers=count, progress=progress
        )
    pictures = []
    if figures:
        from glsim.eval.report.document import CaptionedPng
        from glsim.eval.report.figures.real_frames import measures_figure
        from glsim.eval.report.figures.style import to_png

        caption = "All measures; edges: shares."
        pictures = [CaptionedPng("measures", caption, to_png(measures_figure(scores)))]
    if as_json:
        print_json(scores.as_json())
    else:
        _print_summary(scores, with_pairs=len(opened.partner) > 0)
    with cli_eval.named_losses(out / "table.md"):
        print_written(write_real_frames(scores, out, pictures, remarks))


def _pattern(text: str) -> tuple[int, int]:
    """Parse the option for a board's inner corners. Raises ConfigError."""
    numbers = text.split("x")
    if len(numbers) != 2 or not all(n.isdigit() and int(n) >= 3 for n in numbers):
        raise ConfigError(f"--board {text}: give its inner corners, such as 5x7, at least 3x3")
    return int(numbers[0]), int(numbers[1])


def _print_summary(scores: RealScores, with_pairs: bool) -> None:
    """Print a table of the main measures of each method to stdout."""
    from rich.table import Table

    from glsim.eval.report.score_tables import format_number

    frames = f"{len(scores.checksums)} {scores.kind}"
    title = f"{scores.title}: {frames}; pairs, planes, board: change of the error"
    table = Table("method", title=title)
    heads = ("static pairs [%]", "planes [%]", "board [%]", "largest shift [mm]", "ring lost [%]",
             "filled [%]", "lone filled", "pinholes")  # fmt: skip
    for head in heads:
        table.add_column(head, justify="right")
    for name, m in scores.methods.items():
        numbers = (
            m.pair_change.value, m.plane_change.value, m.paper_change.value, m.largest_shift_mm,
            100 * m.edges["ring_1_lost"], 100 * m.edges["shadow_filled"],
            m.edges["alone_filled"], m.edges["pinholes"],
        )  # fmt: skip
        table.add_row(name, *map(format_number, numbers))
    print_table(table)
    if with_pairs:
        print_message(
            "static pairs cannot see an error that stays from frame to frame, such as a stereo "
            "camera's: planes show it"
        )
