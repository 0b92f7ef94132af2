"""``glsim generate --plan``: print size and time of a data set without writing it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from glsim.cli.common import make_console, options

if TYPE_CHECKING:
    from glsim.settings.schema import Settings

#: Bytes a pixel of a layer that shows a room or a wall, and of one that shows a face alone, which
#: has at most _FACE_BYTES; bytes of a record; measured with kinect-v2.
_ROOM_BYTES_PER_PX, _FACE_BYTES_PER_PX, _FACE_BYTES, _RECORD_BYTES = 0.9, 0.4, 20_000, 1_600
#: Pixels of an image that is not cropped: kinect-v2.
_IMAGE_PX = 512 * 424
#: Seconds of one core for a frame in a room, and of a face alone: measured with kinect-v2 on a
#: two-core cloud machine with Mesa's software rasteriser (on a slower one 0.172 and 0.035).
_ROOM_S, _FACE_S = 0.12, 0.025


def print_plan(settings: Settings, workers: int) -> None:
    """Print the number of images by source and split, their size, and the time.

    Args:
        settings: of the data set.
        workers: number of processes that share the work.
    """
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
    """Return the bytes of a frame, images and record, and the seconds that one core takes."""
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
