"""``glsim generate --plan``: print size and time of a data set without writing it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.table import Table

from glsim.cli.common import console, make_console, options
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.settings.distribution import Distribution
    from glsim.settings.scene_settings import SceneSettings
    from glsim.settings.schema import Settings


def print_plan(
    settings: Settings,
    workers: int,
    backend: str | None,
    price_per_core_hour: float | None = None,
    frames_per_second: float | None = None,
) -> None:
    """Print the number of images by source and split, their size, the time and the price.

    With --verbose also those of each person. frames_per_second: of one core, instead of a sample's.
    """
    from glsim.dataset.estimate import SAMPLE_FRAMES, estimate_dataset
    from glsim.pipeline import open_sources
    from glsim.plan.paper_split import PAPER_IMAGES
    from glsim.plan.tasks import make_tasks
    from glsim.sensors.sensor import sensor_code

    for name, value in (("price-per-core-hour", price_per_core_hour), ("frames-per-second",
                        frames_per_second)):  # fmt: skip
        if value is not None and not 0 < value < math.inf:
            raise ConfigError(f"--{name} {value:g}: give a number above 0")
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    code = sensor_code(settings)  # a plan runs none of it, and so measures nothing
    estimate = estimate_dataset(
        settings,
        sources,
        tasks,
        workers=workers,
        backend=backend,
        sample=0 if code else SAMPLE_FRAMES,
        frames_per_second=frames_per_second,
    )
    out = make_console(width=120)
    if options.verbose:
        for person in tasks.people():
            source = f"{person.source} {sources[person.source].name}"
            out.print(f"{source}  {person.subject}  {person.split}  {person.frames} images")
    sums = Table("source", "people", "images", box=None)
    for source, (persons, images) in estimate.by_source.items():
        sums.add_row(source, str(persons), str(images))
    out.print(sums)
    splits = Table("split", "people", "images", "share", "the paper", box=None)
    for (split, (persons, images)), paper in zip(
        estimate.by_split.items(), PAPER_IMAGES, strict=True
    ):
        share = f"{100 * images / max(1, estimate.frames):.1f} %"
        splits.add_row(split, str(persons), str(images), share, str(paper))
    out.print(splits)
    out.print(scene_line(settings.scene))
    basis = (
        f"measured on {estimate.measured_frames} frames"
        if estimate.measured_frames
        else f"typical values; the code of {', '.join(code)} was not run"
        if code
        else "typical values"
    )
    if estimate.given_speed:
        basis = f"{frames_per_second:g} frames/s of a core as given; size: {basis}"
    out.print(
        f"{estimate.frames} images, {_bytes(estimate.bytes)}, {_time(estimate.seconds)} with "
        f"{estimate.workers} worker(s) ({basis}); nothing was written"
    )
    if price_per_core_hour is not None:
        hours = estimate.core_hours
        out.print(
            f"{hours:.3g} core-hours: {hours * price_per_core_hour:.2f} at {price_per_core_hour:g} "
            "per core-hour; storage and traffic are not in it"
        )
    for why in dict.fromkeys(estimate.skipped):
        console.print(f"would be skipped: {why}", style="yellow")


def scene_line(scene: SceneSettings) -> str:
    """Return what the settings [scene] put around the faces, in a line."""
    if scene.wall_mm is not None:
        return f"scene: a wall at {_range(scene.wall_mm)} mm"
    if scene.room == "none":
        return "scene: nothing behind the faces"
    camera = (
        "as high as the face" if scene.camera_mm is None else f"{_range(scene.camera_mm)} mm high"
    )
    return (
        f"scene: room {scene.room!r}, one per {scene.per}, back wall {_range(scene.behind_mm)} mm "
        f"behind the face, camera {camera}, clutter {_range(scene.clutter)}, "
        f"{_range(scene.people)} other people"
    )


def _range(setting: Distribution) -> str:
    low, high = setting.bounds()
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _bytes(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
