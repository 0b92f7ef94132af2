"""``glsim eval --real``: score denoisers on real recordings, which have no clean truth."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from glsim.cli.common import print_message, print_table, print_written
from glsim.cli.progress import scoring_progress
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.eval.real_frames import RealScores

#: Scored without --denoiser: the shipped network.
_DEFAULT = ("face",)


def evaluate_real(
    recording_path: Path,
    denoisers: Sequence[str],
    out: Path,
    *,
    tune: bool,
    figures: bool,
    focal_px: float | None,
    board: str,
    markdown: Path | None,
    workers: int,
) -> None:
    """Score denoisers on a folder of real frames; write tables and figures into ``out``.

    board: inner corners of the chessboard, such as 5x7. markdown: also write the tables there.
    """
    from glsim.eval.real_frames import score_recording, split_recording, tune_on_pairs
    from glsim.eval.real_frames.split import Source
    from glsim.eval.report.real_frames_page import real_frames_document, write_real_frames
    from glsim.files.atomic import write_atomic

    recording = split_recording(Source(recording_path, focal_px, pattern=_pattern(board)))
    specs = list(denoisers or _DEFAULT)
    remarks: list[str] = []
    if tune:
        with scoring_progress("tuning") as progress:
            tuned, _ = tune_on_pairs(recording, workers=workers, progress=progress)
        specs = list(dict.fromkeys([*tuned, *specs]))
        half = "scenes" if recording.by_scene else "tiles of 64 x 64 px, as a chessboard"
        print_message(f"tuned on half of the {half}: {' '.join(tuned)}")
        remarks.append(
            f"Filters with settings are tuned on the static pairs of one half of the {half}; "
            "static pairs of all methods are scored on the other half."
        )
    if len(recording.partner) == 0:
        remarks.append("No two frames show one static view: there are no static pairs.")
    with scoring_progress("scoring") as progress:
        scores = score_recording(
            recording, specs, scoring_half=tune, workers=workers, progress=progress
        )
    pictures = []
    if figures:
        from glsim.eval.report.document import CaptionedPng
        from glsim.eval.report.figures.real_frames import crops_figure, measures_figure
        from glsim.eval.report.figures.style import to_png

        pictures = [
            CaptionedPng(
                "measures", "All measures; edges: shares.", to_png(measures_figure(scores))
            ),
            CaptionedPng(
                "crops",
                "A part of one frame by every method: shaded, and its difference from the raw "
                "frame.",
                to_png(crops_figure(recording, specs)),
            ),
        ]
    _print_summary(scores)
    paths = write_real_frames(scores, out, pictures, remarks)
    if markdown is not None:
        command = f"glsim eval --real {shlex.quote(recording.source.path.name)}"
        command += " --tune" * tune + "".join(f" -d {shlex.quote(d)}" for d in denoisers)
        document = real_frames_document(scores, [f"Made by `{command}`.", *remarks])
        write_atomic(document.markdown().encode(), markdown)
        paths.append(markdown)
    print_written(paths)


def _pattern(text: str) -> tuple[int, int]:
    """Parse the corners of a board. Raises ConfigError."""
    numbers = text.split("x")
    if len(numbers) != 2 or not all(n.isdigit() and int(n) >= 3 for n in numbers):
        raise ConfigError(f"--board {text}: give its inner corners, such as 5x7, at least 3x3")
    return int(numbers[0]), int(numbers[1])


def _print_summary(scores: RealScores) -> None:
    """Print the tables' last columns and the edges on stdout."""
    from rich.table import Table

    from glsim.eval.report.tables import format_number

    table = Table("method", title=f"{scores.title}: {len(scores.checksums)} real frames")
    heads = ("static pairs [%]", "board [%]", "largest shift [mm]", "ring lost [%]",
             "filled [%]", "lone filled", "pinholes")  # fmt: skip
    for head in heads:
        table.add_column(head, justify="right")
    for name, m in scores.methods.items():
        numbers = (
            m.pair_change.value, m.paper_change.value, m.largest_shift_mm,
            100 * m.edges["ring_1_lost"], 100 * m.edges["shadow_filled"],
            m.edges["alone_filled"], m.edges["pinholes"],
        )  # fmt: skip
        table.add_row(name, *map(format_number, numbers))
    print_table(table)
