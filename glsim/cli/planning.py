"""``glsim generate --plan``: the data set in numbers, before anything is made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from glsim.cli.common import console

if TYPE_CHECKING:
    from glsim.config import Settings
    from glsim.dataset import Workers


def print_plan(settings: Settings, workers: Workers, backend: str | None) -> None:
    """Print counts by source, subject and split, the size and the time."""
    from glsim.dataset.run import available_workers
    from glsim.forecast import forecast
    from glsim.papersplit import PAPER_IMAGES
    from glsim.pipeline import open_sources
    from glsim.plan import make_tasks

    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    ahead = forecast(settings, sources, tasks, workers=available_workers(workers), backend=backend)
    out = Console(highlight=False)
    if not out.is_terminal:
        out = Console(highlight=False, width=120)
    people = Table("source", "subject", "split", "images", box=None)
    for source, subject, split, count in ahead.rows:
        people.add_row(source, subject, split, str(count))
    out.print(people)
    sums = Table("source", "people", "images", box=None)
    for source, (persons, images) in ahead.by_source().items():
        sums.add_row(source, str(persons), str(images))
    out.print(sums)
    splits = Table("split", "people", "images", "share", "the paper", box=None)
    for (split, (persons, images)), paper in zip(
        ahead.by_split().items(), PAPER_IMAGES, strict=True
    ):
        share = f"{100 * images / max(1, ahead.frames):.1f} %"
        splits.add_row(split, str(persons), str(images), share, str(paper))
    out.print(splits)
    how = f"measured on {ahead.measured} frames" if ahead.measured else "typical values"
    out.print(
        f"{ahead.frames} images, {_bytes(ahead.bytes)}, {_time(ahead.seconds)} with "
        f"{ahead.workers} worker(s) ({how}); nothing was written"
    )
    for why in dict.fromkeys(ahead.skipped):
        console.print(f"would be skipped: {why}", style="yellow", markup=False)


def _bytes(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
