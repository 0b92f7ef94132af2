"""Progress bars on stderr, for commands that generate or score frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from glsim.cli.common import console, options

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

    from glsim.dataset import GenerateProgress
    from glsim.eval.scoring.run import ScoringProgress
    from glsim.eval.studies.runner import Displays


def rate_text(per_second: float) -> str:
    """Return a rate in whole numbers, or with two digits below 10: "12/s", "0.28/s"."""
    return f"{per_second:.0f}/s" if per_second >= 9.95 else f"{per_second:.2g}/s"


@contextmanager
def _bar(*columns: ProgressColumn) -> Iterator[Progress]:
    """Yield bars that appear with ``start``: an error before the first frame has no idle bar."""
    from rich.progress import Progress

    bar = Progress(*columns, console=console)
    try:
        yield bar
    finally:
        if bar.live.is_started:
            bar.stop()


@contextmanager
def generation_progress() -> Iterator[Callable[[GenerateProgress], None] | None]:
    """Show a bar with frames per second, skipped frames and time left; None if --quiet."""
    if options.quiet:
        yield None
        return
    from rich import progress as rich_progress

    columns = (
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn("{task.fields[rate]}  skipped {task.fields[skipped]}  left"),
        rich_progress.TimeRemainingColumn(),
    )
    with _bar(*columns) as bar:
        task = bar.add_task("frames", total=None, rate="", skipped=0)

        def update(state: GenerateProgress) -> None:
            bar.start()
            elapsed = bar.tasks[0].elapsed or 0.0
            rate = (state.done - state.reused) / elapsed if elapsed > 0 else 0.0
            bar.update(
                task,
                total=state.total,
                completed=state.done,
                rate=rate_text(rate),
                skipped=state.skipped,
            )

        yield update


@contextmanager
def scoring_progress(title: str) -> Iterator[Callable[[ScoringProgress], None] | None]:
    """Show a bar with the number of bad frames and the time left; None if --quiet."""
    if options.quiet:
        yield None
        return
    from rich import progress as rich_progress

    columns = (
        rich_progress.TextColumn("{task.description}", markup=False),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn("bad {task.fields[bad]}  left"),
        rich_progress.TimeRemainingColumn(),
    )
    with _bar(*columns) as bar:
        task = bar.add_task(title, total=None, bad=0)

        def update(state: ScoringProgress) -> None:
            bar.start()
            bar.update(task, total=state.total, completed=state.done, bad=state.bad)

        yield update


def study_displays() -> Displays:
    """Return the bars and signals of a study's steps."""
    from glsim.cli.train import stopping, training_progress
    from glsim.eval.studies.runner import Displays

    return Displays(generation_progress, scoring_progress, training_progress, stopping)
