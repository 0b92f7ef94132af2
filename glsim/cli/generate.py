"""``glsim generate``: generate a data set of clean and noisy depth frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import (
    ConfigOption,
    PresetOption,
    SeedOption,
    SensorOption,
    SetOption,
    WorkersOption,
    make_console,
    options,
    overrides,
    print_message,
)
from glsim.cli.progress import generation_progress, print_summary
from glsim.core.errors import ConfigError

if TYPE_CHECKING:
    from glsim.settings.schema import Settings

EXAMPLES = """
glsim generate -o data --subjects 10 --frames-per-subject 30
glsim generate -o data --source ict-facekit --root FaceXModel --set output.crop=128
glsim generate -o data --source folder --root scans --frames-per-subject 20
glsim generate -o data --set output.layers=clean,noisy --set split=0.8,0.1,0.1
glsim generate -o data --sensor kinect-v1 --set 'pose.yaw_deg={uniform=[-30,30]}'
glsim generate -o data --preset office --subjects 200 --plan
glsim generate -o s3://bucket/faces --set output.format=webdataset --ray auto
glsim generate -o shared/data --subjects 100000 --part 3/16   one of 16 jobs
The same command again resumes an interrupted run, or checks a finished one.
"""

#: Bytes a pixel of a layer that shows a room or a wall, and of one that shows a face alone, which
#: has at most _FACE_BYTES; bytes of a record; measured with kinect-v2.
_ROOM_BYTES_PER_PX, _FACE_BYTES_PER_PX, _FACE_BYTES, _RECORD_BYTES = 0.9, 0.4, 20_000, 1_600
#: Pixels of an image that is not cropped: kinect-v2.
_IMAGE_PX = 512 * 424
#: Seconds of one core for a frame in a room, and of a face alone: measured with kinect-v2 on a
#: two-core cloud machine with Mesa's software rasteriser (on a slower one 0.172 and 0.035).
_ROOM_S, _FACE_S = 0.12, 0.025


def generate(
    out: Annotated[str | None, typer.Option("-o", "--out")] = None,
    source: str | None = None,
    root: Path | None = None,
    subjects: int | None = None,
    frames_per_subject: int | None = None,
    sensor: SensorOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    preset: PresetOption = None,
    plan: Annotated[bool, typer.Option("--plan")] = False,
    config: ConfigOption = None,
    workers: WorkersOption = "auto",
    part: Annotated[str | None, typer.Option(metavar="I/N")] = None,
    ray: Annotated[str | None, typer.Option(metavar="ADDRESS")] = None,
) -> None:
    """Generate a data set of clean and noisy depth frames, split by subject; resumable.

    Without options: 10 embedded heads, 30 frames each, 0.9 m before a kinect-v2, whole images. A
    seed gives the same bytes on all x86-64 processors since 2013. What has no option here is a
    setting: glsim presets lists collections of them, docs/reference/settings.md all.

    Args:
        out: Folder for the data set, or a URL such as s3://bucket/faces for shards. Default: none;
            --plan needs no folder.
        source: Source of faces: procedural, people, ict-facekit, folder, facewarehouse, d3dfacs,
            biwi, or one of an installed package. Default: procedural.
        root: Folder of the meshes or of the face model. Default: none.
        subjects: Number of people. Default: all of a folder, else 10.
        frames_per_subject: Frames per person; a folder's meshes are used again, with other poses
            and noise. Default: all of a folder, else 30.
        plan: Print the number of images, and estimates of size and time; render nothing.
        part: Make only the chunks whose number modulo N is I (from 0, or from 1 to N); the last
            part to end merges all. Default: all chunks.
        ray: Render on a cluster of Ray: auto, HOST:6379, or local (pip install 'glsim[ray]').
            Default: on this machine.
    """
    from glsim.data.worker_processes import worker_count
    from glsim.settings.schema import load_settings

    faces = overrides(
        kind=source, root=root, subjects=subjects, frames_per_subject=frames_per_subject
    )
    settings = load_settings(
        config, assignments or [], overrides(sensor=sensor, seed=seed), faces, preset
    )
    if plan:
        _print_plan(settings, worker_count(workers))
        return
    if out is None:
        raise ConfigError("give -o DIR, the folder of the data set (or --plan to print the plan)")
    if part is not None and ray is not None:
        raise ConfigError("--part and --ray exclude each other: give one of them")
    from glsim.data.chunks import parse_part
    from glsim.data.driver import generate as make_all
    from glsim.data.driver import generate_part

    count = worker_count(workers)
    if part is None:
        with generation_progress() as progress:
            whole = make_all(
                settings, out, workers=count, portable=True, ray=ray, progress=progress
            )
        print_summary(whole, out)
        return
    chosen = parse_part(part)
    with generation_progress() as progress:
        made = generate_part(settings, out, chosen, workers=count, portable=True, progress=progress)
    print_message(
        f"{out}: part {chosen}: {made.frames} frames and {made.skipped} skipped, {made.rendered} "
        f"of them in this run of {made.seconds:.1f} s"
    )
    if made.dataset is not None:
        print_summary(made.dataset, out)
    else:
        print_message(
            f"{made.absent_chunks} chunks of other parts are not made yet; the last part merges"
        )


def _print_plan(settings: Settings, workers: int) -> None:
    """Print the number of images by source and split, their size, and the estimated time."""
    from rich.table import Table

    from glsim.sensors.sensor import sensor_code, sensor_of
    from glsim.settings.schema import SPLIT_NAMES
    from glsim.simulation.pipeline import open_sources
    from glsim.simulation.plan.tasks import make_tasks

    if not sensor_code(settings):  # a plan runs none
        sensor_of(settings)
    sources = open_sources(settings)
    plan = make_tasks(settings, sources)
    out = make_console(width=120)
    by_source: dict[str, tuple[int, int]] = {}
    by_split = dict.fromkeys(SPLIT_NAMES, (0, 0))
    for person in plan.people():
        source = f"{person.source} {sources[person.source].name}"
        if options.verbose:
            out.print(f"{source}  {person.subject}  {person.split}  {person.frames} images")
        for sums, key in ((by_source, source), (by_split, person.split)):
            people, images = sums.get(key, (0, 0))
            sums[key] = people + 1, images + person.frames
    for head, sums in (("source", by_source), ("split", by_split)):
        table = Table(head, "people", "images", "share", box=None)
        for name, (people, images) in sums.items():
            share = f"{100 * images / len(plan):.1f} %"
            table.add_row(name, str(people), str(images), share)
        out.print(table)
    frame_bytes, frame_s = _frame_cost(settings)
    out.print(
        f"{len(plan)} images, {_bytes(len(plan) * frame_bytes)}, "
        f"{_time(len(plan) * frame_s / workers)} with {workers} worker(s), on a typical machine; "
        "nothing was rendered or written"
    )


def _frame_cost(settings: Settings) -> tuple[float, float]:
    """Estimate the bytes of a frame (images and record), and its seconds on one core."""
    crop = settings.output.crop
    image_px = _IMAGE_PX if crop is None else crop**2
    in_room = settings.scene.room != "none" or settings.scene.wall_mm is not None
    face_bytes = min(_FACE_BYTES_PER_PX * image_px, _FACE_BYTES)
    layer_bytes = _ROOM_BYTES_PER_PX * image_px if in_room else face_bytes
    total = len(settings.output.layers) * layer_bytes + _RECORD_BYTES
    return total, _ROOM_S if in_room else _FACE_S


def _bytes(count: float) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
