"""``glsim generate --plan``: print size and time of a data set without writing it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from glsim.cli.common import make_console, options

if TYPE_CHECKING:
    from glsim.settings.schema import Settings


def print_plan(settings: Settings, workers: int) -> None:
    """Print the number of images by source and split, their size, and the time.

    Args:
        settings: of the data set.
        workers: number of processes that share the work.
    """
    from glsim.dataset.estimate import estimate_dataset
    from glsim.pipeline import open_sources
    from glsim.plan.tasks import make_tasks
    from glsim.sensors.sensor import sensor_code, sensor_of

    if not sensor_code(settings):  # a plan runs none
        sensor_of(settings)
    sources = open_sources(settings)
    plan = make_tasks(settings, sources)
    estimate = estimate_dataset(settings, sources, plan)
    out = make_console(width=120)
    if options.verbose:
        for person in plan.people():
            source = f"{person.source} {sources[person.source].name}"
            out.print(f"{source}  {person.subject}  {person.split}  {person.frames} images")
    for head, sums in (("source", estimate.by_source), ("split", estimate.by_split)):
        table = Table(head, "people", "images", "share", box=None)
        for name, (people, images) in sums.items():
            share = f"{100 * images / estimate.frames:.1f} %"
            table.add_row(name, str(people), str(images), share)
        out.print(table)
    out.print(
        f"{estimate.frames} images, {_bytes(estimate.bytes)}, "
        f"{_time(estimate.core_seconds / workers)} with {workers} worker(s), on a typical machine; "
        "nothing was rendered or written"
    )


def _bytes(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
