"""What a data set will be before it is made: images by source, subject and split, bytes, time."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from glsim.config import SPLIT_NAMES, Settings
from glsim.dataset.files import check_bytes, to_json
from glsim.dataset.png import encode_png
from glsim.dataset.record import frame_record
from glsim.errors import DeviceError
from glsim.faces.base import FaceSource
from glsim.frame import Frame
from glsim.pipeline import simulate
from glsim.plan import Task

SAMPLE = 12
"""Frames that are made to measure size and time, spread evenly over the plan."""

#: Where nothing can be rendered here: bytes a layer and a record, and seconds of one core, of a
#: 512 x 424 frame on two cores of a cloud machine with Mesa's software rasteriser.
TYPICAL_LAYER_BYTES = 18_000
TYPICAL_RECORD_BYTES = 1_600
TYPICAL_SECONDS = 0.025


@dataclass(frozen=True)
class Forecast:
    """rows: (source's number and kind, subject, split, images). bytes: on disk, all in all.

    seconds: of wall time with ``workers`` processes. measured: frames the two were measured on;
    0 where constants had to do. skipped: frames of the sample that could not be made, and why.
    """

    rows: Sequence[tuple[str, str, str, int]]
    bytes: int
    seconds: float
    workers: int
    measured: int
    skipped: Sequence[str] = ()

    @property
    def frames(self) -> int:
        """All images (pairs)."""
        return sum(row[3] for row in self.rows)

    def by_split(self) -> dict[str, tuple[int, int]]:
        """Split -> people, images."""
        people = Counter(split for _, _, split, _ in self.rows)
        images: Counter[str] = Counter()
        for _, _, split, count in self.rows:
            images[split] += count
        return {split: (people[split], images[split]) for split in SPLIT_NAMES}

    def by_source(self) -> dict[str, tuple[int, int]]:
        """Source -> people, images."""
        found: dict[str, tuple[int, int]] = {}
        for source, _, _, count in self.rows:
            people, images = found.get(source, (0, 0))
            found[source] = people + 1, images + count
        return found


def forecast(
    settings: Settings,
    sources: Sequence[FaceSource],
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    sample: int = SAMPLE,
    backend: str | None = None,
) -> Forecast:
    """Look ahead; a small sample is made and thrown away. Nothing is written.

    sample: 0 takes the constants above, as does a machine without OpenGL.
    """
    images = Counter((task.source, task.subject, task.split) for task in tasks)
    rows = [
        (f"{number} {sources[number].name}", subject, split, count)
        for (number, subject, split), count in images.items()
    ]
    layers = len(settings.output.layers)
    each_bytes = float(layers * TYPICAL_LAYER_BYTES + TYPICAL_RECORD_BYTES)
    each_s, skipped = TYPICAL_SECONDS, []
    sizes: list[int] = []
    # The first frame opens the context and compiles; the second time round it is not counted.
    step = max(1, len(tasks) // max(1, sample))
    chosen = tasks[::step][:sample]
    started = 0.0
    try:
        warm = [*chosen[:1], *chosen]
        for number, (task, result) in enumerate(
            zip(warm, simulate(settings, warm, sources=sources, backend=backend,
                               layers=settings.output.layers), strict=True)
        ):  # fmt: skip
            if isinstance(result, Frame):
                size = _size(settings, task, result)
            if number == 0:
                started = time.monotonic()
            elif isinstance(result, Frame):
                sizes.append(size)
            else:
                skipped.append(result.why)
        if sizes:
            each_bytes = sum(sizes) / len(sizes)
            each_s = (time.monotonic() - started) / len(chosen)
    except DeviceError:
        sizes = []
    total = len(tasks)
    return Forecast(
        rows, round(total * each_bytes), total * each_s / workers, workers, len(sizes), skipped
    )


def _size(settings: Settings, task: Task, frame: Frame) -> int:
    """Bytes of a frame's images and of its record in the manifest."""
    images = {layer: encode_png(frame.image(layer)) for layer in settings.output.layers}
    files: dict[str, dict[str, object]] = {
        str(layer): {"name": layer, **check_bytes(data)} for layer, data in images.items()
    }
    record = to_json(frame_record(task, frame, files), task.stem)
    return sum(len(data) for data in images.values()) + len(record)
