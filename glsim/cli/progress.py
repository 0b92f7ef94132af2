"""Progress bars on stderr, for commands that generate or score frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from glsim.cli.common import console, options

if TYPE_CHECKING:
    from glsim.dataset import GenerateProgress
    from glsim.eval.scoring.run import ScoringProgress


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
    with rich_progress.Progress(*columns, console=console) as bar:
        task = bar.add_task("frames", total=None, rate="", skipped=0)

        def update(state: GenerateProgress) -> None:
            elapsed = bar.tasks[0].elapsed or 0.0
            rate = (state.done - state.reused) / elapsed if elapsed > 0 else 0.0
            bar.update(
                task,
                total=state.total,
                completed=state.done,
                rate=f"{rate:.0f}/s",
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
    with rich_progress.Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=None, bad=0)

        def update(state: ScoringProgress) -> None:
            bar.update(task, total=state.total, completed=state.done, bad=state.bad)

        yield update
