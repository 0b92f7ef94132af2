"""``glsim generate``: from settings to a data set on disk."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from glsim.config import Settings
from glsim.dataset.run import Progress, Summary, Workers, write_dataset
from glsim.plan import make_tasks


def generate(
    settings: Settings,
    out: Path,
    *,
    workers: Workers = "auto",
    backend: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Make the data set that ``settings`` describe in the folder ``out``; again to resume.

    The same settings on the same renderer give the same bytes. backend: "egl" or "osmesa".
    Raises what ``write_dataset`` and ``glsim.pipeline.simulate`` raise.
    """
    # Here, because reading a data set needs no OpenGL.
    from glsim.gl.context import describe, open_context
    from glsim.pipeline import open_sources, simulate
    from glsim.sensor import sensor_of

    sensor = sensor_of(settings)
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    context = open_context(backend)
    renderer = describe(context)["renderer"]
    context.release()
    return write_dataset(
        settings,
        tasks,
        out,
        partial(simulate, sources=sources, backend=backend),
        sensor=sensor.describe(),
        renderer=renderer,
        workers=workers,
        progress=progress,
    )
