"""Progress bars on stderr for commands that generate or score frames, and a final summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from glsim.cli.common import as_typed, console, options, print_message
from glsim.core.errors import DatasetError, counted

if TYPE_CHECKING:
    from glsim.data.progress import FrameProgress, GenerateSummary


def rate_text(per_second: float) -> str:
    """Format a rate in whole numbers, or with two digits below 10: "12/s", "0.28/s"."""
    return f"{per_second:.0f}/s" if per_second >= 9.95 else f"{per_second:.2g}/s"


@contextmanager
def frame_progress(title: str = "") -> Iterator[Callable[[FrameProgress], None] | None]:
    """Yield the update of a bar with frame rate, skipped frames, time left; None if --quiet.

    The bar appears with the first call: an error before the first frame has no idle bar.
    """
    if options.quiet:
        yield None
        return
    from rich import progress

    note = progress.TextColumn("{task.fields[rate]}  skipped {task.fields[skipped]}  left")
    bar = progress.Progress(
        progress.TextColumn("{task.description}", markup=False), progress.BarColumn(),
        progress.MofNCompleteColumn(), note, progress.TimeRemainingColumn(), console=console,
    )  # fmt: skip
    task = bar.add_task(title, total=None, rate="", skipped=0)
    started = time.monotonic()

    def update(state: FrameProgress) -> None:
        bar.start()
        rate = rate_text((state.done - state.reused) / max(1e-6, time.monotonic() - started))
        bar.update(task, total=state.total, completed=state.done, rate=rate, skipped=state.skipped)

    try:
        yield update
    finally:
        if bar.live.is_started:
            bar.stop()


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
    total = sum(summary.frames.values())
    frames = ", ".join(f"{split} {count}" for split, count in summary.frames.items())
    people = ", ".join(f"{split} {count}" for split, count in summary.subjects.items())
    print_message(f"{out}: {counted(total, 'frame')} ({frames}) of subjects ({people})")
    if summary.reused:
        print_message(f"{counted(summary.reused, 'frame')}, made or skipped, complete already")
    if summary.rendered and summary.bytes:
        print_message(
            f"{summary.rendered} made{' or skipped' * bool(summary.skipped)} in "
            f"{summary.seconds:.1f} s: {rate_text(summary.rendered / summary.seconds)}, "
            f"{1000 * summary.cpu_seconds / summary.rendered:.1f} ms of CPU each, "
            f"{summary.bytes / 1e6:.1f} MB"
        )
    for why, count in sorted(summary.skipped.items(), key=lambda item: -item[1])[:10]:
        alone = "; source.overrides sets it for one mesh" if total and "source.unit" in why else ""
        console.print(as_typed(f"skipped {count}: {why}{alone}"), style="yellow", soft_wrap=True)
    for note in summary.notes:
        print_message(note)
    if not total:
        raise DatasetError(f"{out}: no frame could be made, see {out}/skipped.jsonl")
