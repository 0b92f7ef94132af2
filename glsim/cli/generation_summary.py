"""What commands that write a data set say at their end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from glsim.cli.common import console, print_message
from glsim.cli.progress import rate_text
from glsim.errors import DatasetError
from glsim.files.store import open_store

if TYPE_CHECKING:
    from glsim.dataset import GenerateSummary


def print_summary(summary: GenerateSummary, out: Path) -> None:
    """Print a summary of a run. Raises DatasetError if it has no frame."""
    frames = ", ".join(f"{split} {count}" for split, count in summary.frames.items())
    people = ", ".join(f"{split} {count}" for split, count in summary.subjects.items())
    where = open_store(out)
    print_message(
        f"{where}: {sum(summary.frames.values())} frames ({frames}) of subjects ({people})"
    )
    if summary.reused:
        print_message(f"{summary.reused} of them were complete already")
    if summary.rendered:
        milliseconds = 1000 * summary.cpu_seconds / summary.rendered
        print_message(
            f"{summary.rendered} rendered in {summary.seconds:.1f} s: "
            f"{rate_text(summary.rendered / summary.seconds)}, {milliseconds:.1f} ms of CPU each, "
            f"{summary.bytes / 1e6:.1f} MB"
        )
    for why, count in sorted(summary.skipped.items(), key=lambda item: -item[1])[:10]:
        console.print(f"skipped {count}: {why}", style="yellow")
    if not sum(summary.frames.values()):
        raise DatasetError(f"{where}: no frame could be made, see {where}/skipped.jsonl")
