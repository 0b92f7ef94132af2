"""Progress bars on stderr for commands that generate or score frames, and a final summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glsim.cli.common import as_typed, console, options, print_message
from glsim.core.errors import DatasetError

if TYPE_CHECKING:
    from glsim.data.progress import GenerateProgress, GenerateSummary
    from glsim.eval.scoring.evaluate import ScoringProgress


def rate_text(per_second: float) -> str:
    """Format a rate in whole numbers, or with two digits below 10: "12/s", "0.28/s"."""
    return f"{per_second:.0f}/s" if per_second >= 9.95 else f"{per_second:.2g}/s"


@contextmanager
def _bar(title: str, note: str) -> Iterator[Callable[..., None] | None]:
    """Yield a function that updates a bar with a note and the time left; yield None if --quiet.

    The bar appears with the first call: an error before the first frame has no idle bar.
    """
    if options.quiet:
        yield None
        return
    from rich import progress

    bar = progress.Progress(
        progress.TextColumn("{task.description}", markup=False), progress.BarColumn(),
        progress.MofNCompleteColumn(), progress.TextColumn(note), progress.TimeRemainingColumn(),
        console=console,
    )  # fmt: skip
    task = bar.add_task(title, total=None, rate="", number=0)

    def update(done: int, total: int, **fields: Any) -> None:
        bar.start()
        bar.update(task, total=total, completed=done, **fields)

    try:
        yield update
    finally:
        if bar.live.is_started:
            bar.stop()


@contextmanager
def generation_progress() -> Iterator[Callable[[GenerateProgress], None] | None]:
    """Yield the update of a bar with frame rate, skipped frames, time left; None if --quiet."""
    with _bar("", "{task.fields[rate]}  skipped {task.fields[number]}  left") as move:
        started = time.monotonic()

        def update(state: GenerateProgress) -> None:
            assert move is not None
            per_second = (state.done - state.reused) / max(1e-6, time.monotonic() - started)
            move(state.done, state.total, rate=rate_text(per_second), number=state.skipped)

        yield None if move is None else update


@contextmanager
def scoring_progress(title: str) -> Iterator[Callable[[ScoringProgress], None] | None]:
    """Yield the update of a bar with bad frames and time left; yield None if --quiet."""
    with _bar(title, "bad {task.fields[number]}  left") as move:

        def update(state: ScoringProgress) -> None:
            assert move is not None
            move(state.done, state.total, number=state.bad)

        yield None if move is None else update


@contextmanager
def step_progress(first: str) -> Iterator[Callable[[str], None]]:
    """Yield a function that prints the next step's name; on a terminal a clock runs beside it."""
    from rich import progress

    text = progress.TextColumn("{task.description}", markup=False)
    columns = progress.SpinnerColumn(), text, progress.TimeElapsedColumn()
    hidden = options.quiet or not console.is_terminal
    with progress.Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task(first)

        def step(name: str) -> None:
            print_message(name)
            bar.reset(task, description=name)

        step(first)
        yield step


def print_summary(summary: GenerateSummary, out: Path | str) -> None:
    """Print a summary of a generation. Raises DatasetError if there are no frames."""
    frames = ", ".join(f"{split} {count}" for split, count in summary.frames.items())
    people = ", ".join(f"{split} {count}" for split, count in summary.subjects.items())
    print_message(f"{out}: {sum(summary.frames.values())} frames ({frames}) of subjects ({people})")
    if summary.reused:
        print_message(f"{summary.reused} frames, made or skipped, were complete already")
    if summary.rendered and summary.bytes:
        print_message(
            f"{summary.rendered} made{' or skipped' * bool(summary.skipped)} in "
            f"{summary.seconds:.1f} s: {rate_text(summary.rendered / summary.seconds)}, "
            f"{1000 * summary.cpu_seconds / summary.rendered:.1f} ms of CPU each, "
            f"{summary.bytes / 1e6:.1f} MB"
        )
    for why, count in sorted(summary.skipped.items(), key=lambda item: -item[1])[:10]:
        console.print(as_typed(f"skipped {count}: {why}"), style="yellow", soft_wrap=True)
    for note in summary.notes:
        print_message(note)
    if not sum(summary.frames.values()):
        raise DatasetError(f"{out}: no frame could be made, see {out}/skipped.jsonl")
