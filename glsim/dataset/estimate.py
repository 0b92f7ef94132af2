"""Estimate a data set before it is generated: images by source, subject and split, bytes, time."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from glsim.dataset.records import frame_record
from glsim.errors import DeviceError
from glsim.faces.base import FaceSource
from glsim.files.atomic import checksum, to_json
from glsim.files.png import encode_png
from glsim.frame import Frame
from glsim.pipeline import simulate
from glsim.plan.tasks import Task
from glsim.settings.schema import SPLIT_NAMES, Settings

#: Number of frames that are made to measure size and time, spread evenly over the plan.
SAMPLE_FRAMES = 12

#: Values for a machine that cannot render: bytes per layer and per record, and seconds of one core
#: per 512 x 424 frame, measured on a two-core cloud machine with Mesa's software rasteriser.
TYPICAL_LAYER_BYTES = 18_000
TYPICAL_RECORD_BYTES = 1_600
TYPICAL_SECONDS = 0.025


@dataclass(frozen=True)
class DatasetEstimate:
    """The expected contents, size and time of a data set.

    rows: (number and kind of the source, subject, split, images). bytes: total on disk.
    seconds: wall time with ``workers`` processes. measured_frames: number of frames on which bytes
    and seconds were measured; 0 if they are the constants above. skipped: the reason for each
    sample frame that could not be made.
    """

    rows: Sequence[tuple[str, str, str, int]]
    bytes: int
    seconds: float
    workers: int
    measured_frames: int
    skipped: Sequence[str] = ()

    @property
    def frames(self) -> int:
        """The number of frames (pairs of images)."""
        return sum(row[3] for row in self.rows)

    def by_split(self) -> dict[str, tuple[int, int]]:
        """Return split -> (people, images)."""
        people = Counter(split for _, _, split, _ in self.rows)
        images: Counter[str] = Counter()
        for _, _, split, count in self.rows:
            images[split] += count
        return {split: (people[split], images[split]) for split in SPLIT_NAMES}

    def by_source(self) -> dict[str, tuple[int, int]]:
        """Return source -> (people, images)."""
        counts: dict[str, tuple[int, int]] = {}
        for source, _, _, count in self.rows:
            people, images = counts.get(source, (0, 0))
            counts[source] = people + 1, images + count
        return counts


def estimate_dataset(
    settings: Settings,
    sources: Sequence[FaceSource],
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    sample: int = SAMPLE_FRAMES,
    backend: str | None = None,
) -> DatasetEstimate:
    """Estimate a data set from a small sample of frames; nothing is written.

    sample: number of frames; 0, or a machine without OpenGL, uses the constants above.
    """
    images = Counter((task.source, task.subject, task.split) for task in tasks)
    rows = [
        (f"{number} {sources[number].name}", subject, split, count)
        for (number, subject, split), count in images.items()
    ]
    layers = len(settings.output.layers)
    frame_bytes = float(layers * TYPICAL_LAYER_BYTES + TYPICAL_RECORD_BYTES)
    frame_s, skipped = TYPICAL_SECONDS, []
    sizes: list[int] = []
    # The first task runs twice: its first frame opens the context and compiles shaders, untimed.
    step = max(1, len(tasks) // max(1, sample))
    chosen = tasks[::step][:sample]
    started = 0.0
    try:
        sampled = [*chosen[:1], *chosen]
        results = simulate(
            settings, sampled, sources=sources, backend=backend, layers=settings.output.layers
        )
        for number, (task, result) in enumerate(
            zip(sampled, results if sampled else (), strict=True)
        ):
            if isinstance(result, Frame):
                size = _frame_bytes(settings, task, result)
            if number == 0:
                started = time.monotonic()
            elif isinstance(result, Frame):
                sizes.append(size)
            else:
                skipped.append(result.why)
        if sizes:
            frame_bytes = sum(sizes) / len(sizes)
            frame_s = (time.monotonic() - started) / len(chosen)
    except DeviceError:
        sizes = []
    total = len(tasks)
    return DatasetEstimate(
        rows, round(total * frame_bytes), total * frame_s / workers, workers, len(sizes), skipped
    )


def _frame_bytes(settings: Settings, task: Task, frame: Frame) -> int:
    """Return the bytes of a frame's images and of its record in the manifest."""
    images = {layer: encode_png(frame.image(layer)) for layer in settings.output.layers}
    files: dict[str, dict[str, object]] = {
        str(layer): {"name": layer, **checksum(data)} for layer, data in images.items()
    }
    record = to_json(frame_record(task, frame, files), task.stem)
    return sum(len(data) for data in images.values()) + len(record)
