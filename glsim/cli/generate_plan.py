"""``glsim generate --plan``: print size and time of a data set without writing it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from glsim.cli.common import console, make_console

if TYPE_CHECKING:
    from glsim.settings.distribution import Distribution
    from glsim.settings.scene_settings import SceneSettings
    from glsim.settings.schema import Settings


def print_plan(settings: Settings, workers: int, backend: str | None) -> None:
    """Print the number of images by source, subject and split, their size and the time."""
    from glsim.dataset.estimate import SAMPLE_FRAMES, estimate_dataset
    from glsim.pipeline import open_sources
    from glsim.plan.paper_split import PAPER_IMAGES
    from glsim.plan.tasks import make_tasks
    from glsim.sensors.sensor import sensor_code

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
    )
    out = make_console(width=120)
    people = Table("source", "subject", "split", "images", box=None)
    for source, subject, split, count in estimate.rows:
        people.add_row(source, subject, split, str(count))
    out.print(people)
    sums = Table("source", "people", "images", box=None)
    for source, (persons, images) in estimate.by_source().items():
        sums.add_row(source, str(persons), str(images))
    out.print(sums)
    splits = Table("split", "people", "images", "share", "the paper", box=None)
    for (split, (persons, images)), paper in zip(
        estimate.by_split().items(), PAPER_IMAGES, strict=True
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
    out.print(
        f"{estimate.frames} images, {_bytes(estimate.bytes)}, {_time(estimate.seconds)} with "
        f"{estimate.workers} worker(s) ({basis}); nothing was written"
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
