"""What the commands share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import console, options
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from ..run import Progress

DenoiserOption = Annotated[
    list[str] | None,
    typer.Option(
        "--denoiser",
        "-d",
        metavar="[LABEL@]NAME[:KEY=VALUE,...]",
        help="A shipped denoiser (see eval --list), module:function, or a checkpoint. Repeatable.",
    ),
]
WorkersOption = Annotated[str, typer.Option(help="Processes; auto is one a core.")]
FocalOption = Annotated[
    float | None, typer.Option(help="Focal length of plain PNG files; default: the Kinect V2's.")
]


def processes(text: str) -> int:
    """``--workers`` as a number."""
    from glsim.dataset import available_workers

    if text == "auto":
        return available_workers()
    if not text.isdigit() or int(text) < 1:
        raise ConfigError(f"--workers {text}: give a number of at least 1, or auto")
    return int(text)


@contextmanager
def bar(title: str) -> Iterator[Callable[[Progress], None] | None]:
    """A progress bar on stderr; nothing if --quiet."""
    if options.quiet:
        yield None
        return
    from rich import progress as rich_progress

    columns = (
        rich_progress.TextColumn("{task.description}"),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn("bad {task.fields[bad]}  left"),
        rich_progress.TimeRemainingColumn(),
    )
    with rich_progress.Progress(*columns, console=console) as shown:
        task = shown.add_task(title, total=None, bad=0)

        def update(state: Progress) -> None:
            shown.update(task, total=state.total, completed=state.done, bad=state.bad)

        yield update
