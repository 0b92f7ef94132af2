"""``glsim generate --plan``: print size and time of a data set without writing it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rich.table import Table

from glsim.cli.common import make_console, options, print_json
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.dataset.estimate import DatasetEstimate
    from glsim.settings.distribution import Distribution
    from glsim.settings.scene_settings import SceneSettings
    from glsim.settings.schema import Settings


def print_plan(
    settings: Settings,
    workers: int,
    price_per_core_hour: float | None = None,
    frames_per_second: float | None = None,
    as_json: bool = False,
) -> None:
    """Print the number of images by source and split, their size, the time and the price.

    Args:
        settings: of the data set.
        workers: number of processes that share the work.
        price_per_core_hour: None prints no price.
        frames_per_second: speed of one core; default: a typical one.
        as_json: print JSON.
    """
    from glsim.dataset.estimate import estimate_dataset
    from glsim.pipeline import open_sources
    from glsim.plan.paper_split import PAPER_IMAGES
    from glsim.plan.tasks import make_tasks
    from glsim.sensors.sensor import sensor_code, sensor_of

    for name, value in (("price-per-core-hour", price_per_core_hour), ("frames-per-second",
                        frames_per_second)):  # fmt: skip
        if value is not None and not 0 < value < math.inf:
            raise ConfigError(f"--{name} {value:g}: give a number above 0")
    if not sensor_code(settings):  # a plan runs none
        sensor_of(settings)
    sources = open_sources(settings)
    plan = make_tasks(settings, sources)
    estimate = estimate_dataset(settings, sources, plan, frames_per_second)
    if as_json:
        print_json(_described(estimate, workers, price_per_core_hour))
        return
    out = make_console(width=120)
    if options.verbose:
        for person in plan.people():
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
    speed = (
        "typical" if frames_per_second is None else f"{frames_per_second:g}/s of a core as given"
    )
    out.print(
        f"{estimate.frames} images, {_bytes(estimate.bytes)}, "
        f"{_time(estimate.core_seconds / workers)} with {workers} worker(s) (size: typical; speed: "
        f"{speed}); nothing was rendered or written"
    )
    if price_per_core_hour is not None:
        hours = estimate.core_seconds / 3600
        out.print(
            f"{hours:.3g} core-hours: {hours * price_per_core_hour:.2f} at {price_per_core_hour:g} "
            "per core-hour; storage and traffic are not in it"
        )


def _described(
    estimate: DatasetEstimate, workers: int, price_per_core_hour: float | None
) -> dict[str, Any]:
    """Return the plan as JSON values."""
    hours = estimate.core_seconds / 3600
    return {
        "sources": [
            {"source": name, "people": people, "frames": frames}
            for name, (people, frames) in estimate.by_source.items()
        ],
        "splits": {
            name: {"people": people, "frames": frames}
            for name, (people, frames) in estimate.by_split.items()
        },
        "frames": estimate.frames,
        "bytes": estimate.bytes,
        "core_hours": hours,
        "workers": workers,
        "seconds": estimate.core_seconds / workers,
        "price": None if price_per_core_hour is None else hours * price_per_core_hour,
    }


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
