"""Estimate a data set before it is generated: images by source, subject and split, bytes, time."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from glsim.dataset.records import frame_record
from glsim.errors import DeviceError
from glsim.faces.base import FaceSource
from glsim.files.atomic import checksum, to_json
from glsim.files.png import encode_png
from glsim.frame import Frame
from glsim.pipeline import simulate
from glsim.plan.tasks import Task, people_of
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

    by_source: "number kind" of each source -> (people, images). by_split: split -> the same.
    bytes: total on disk. core_seconds: of one core. seconds: wall time with ``workers`` processes.
    measured_frames: number of frames on which bytes and seconds were measured; 0 if they are the
    constants above. given_speed: whether the caller gave the frames per second. skipped: the
    reason for each sample frame that could not be made.
    """

    by_source: Mapping[str, tuple[int, int]]
    by_split: Mapping[str, tuple[int, int]]
    bytes: int
    core_seconds: float
    workers: int
    measured_frames: int
    given_speed: bool = False
    skipped: Sequence[str] = ()

    @property
    def frames(self) -> int:
        """The number of frames (pairs of images)."""
        return sum(images for _, images in self.by_split.values())

    @property
    def seconds(self) -> float:
        """Wall time, seconds."""
        return self.core_seconds / self.workers

    @property
    def core_hours(self) -> float:
        """Hours of one core."""
        return self.core_seconds / 3600


def estimate_dataset(
    settings: Settings,
    sources: Sequence[FaceSource],
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    sample: int = SAMPLE_FRAMES,
    frames_per_second: float | None = None,
    backend: str | None = None,
) -> DatasetEstimate:
    """Estimate a data set from a small sample of frames; nothing is written.

    sample: number of frames; 0, or a machine without OpenGL, uses the constants above.
    frames_per_second: of one core, where it is known; otherwise it is that of the sample.
    """
    by_source: dict[str, tuple[int, int]] = {}
    by_split = dict.fromkeys(SPLIT_NAMES, (0, 0))
    seen: set[tuple[int, str]] = set()
    for person in people_of(tasks):
        new = (person.source, person.subject) not in seen
        seen.add((person.source, person.subject))
        name = f"{person.source} {sources[person.source].name}"
        for sums, key in ((by_source, name), (by_split, person.split)):
            people, images = sums.get(key, (0, 0))
            sums[key] = people + new, images + person.frames
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
    if frames_per_second is not None:
        frame_s = 1 / frames_per_second
    total = len(tasks)
    return DatasetEstimate(
        by_source,
        by_split,
        round(total * frame_bytes),
        total * frame_s,
        workers,
        len(sizes),
        frames_per_second is not None,
        skipped,
    )


def _frame_bytes(settings: Settings, task: Task, frame: Frame) -> int:
    """Return the bytes of a frame's images and of its record in the manifest."""
    images = {layer: encode_png(frame.image(layer)) for layer in settings.output.layers}
    files: dict[str, dict[str, object]] = {
        str(layer): {"name": layer, **checksum(data)} for layer, data in images.items()
    }
    record = to_json(frame_record(task, frame, files), task.stem)
    return sum(len(data) for data in images.values()) + len(record)
