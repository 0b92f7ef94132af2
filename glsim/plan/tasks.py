"""Plan the frames of a data set: subjects and their splits, and each frame's name and seeds.

The plan depends only on the settings and reads no geometry: any worker can take any part of it, in
any order, and produces the same frames.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from glsim.errors import ConfigError, DatasetError
from glsim.faces.base import FaceKey, FaceSource
from glsim.plan.mixture import mix_sources
from glsim.plan.split import assign_splits
from glsim.settings.distribution import DrawKeys
from glsim.settings.schema import GENERATORS, Settings
from glsim.settings.seeds import stable_seed


@dataclass(frozen=True)
class Task:
    """One frame to make.

    index: position in the data set. split: train, val or test.
    subject: name in the data set, prefixed with the source's number if there are several sources.
    source: position in ``settings.source``. key: the frame's name in that source.
    seeds: 64-bit seeds of the frame, its sequence and its subject. device: number of the virtual
    device.
    """

    index: int
    split: str
    subject: str
    source: int
    key: FaceKey
    seeds: DrawKeys
    device: int

    @property
    def stem(self) -> str:
        """The path of the frame's files in the data set, without ``_<layer>.png``."""
        return f"{self.split}/{self.subject}/{self.key.sequence}_{self.key.frame:05d}"


#: Frames of the largest plan: it is kept in memory, 0.7 kB a frame (measured).
MAX_FRAMES = 10_000_000


def _refuse_too_many(settings: Settings) -> None:
    """Raise ConfigError for more generated frames than a plan can hold."""
    for source in settings.source:
        people, each = source.subjects or 1, source.frames_per_subject or 1
        if source.kind in GENERATORS and people * each > MAX_FRAMES:
            raise ConfigError(
                f"{people} subjects of {each} frames are {people * each} frames; one data set "
                f"has at most {MAX_FRAMES}: make several, with other seeds"
            )


def make_tasks(settings: Settings, sources: list[FaceSource]) -> list[Task]:
    """Make the whole plan, ordered by source, subject and frame. ConfigError if it is empty."""
    _refuse_too_many(settings)
    people: list[tuple[int, str, str]] = []
    for number, source in enumerate(sources):
        for name in source.subjects(settings.source[number].subjects):
            people.append((number, name, f"{number}-{name}" if len(sources) > 1 else name))
    frames = [
        (number, sources[number].frames(name, settings.source[number].frames_per_subject))
        for number, name, _ in people
    ]
    chosen = mix_sources(settings.source, frames)
    splits = assign_splits(
        settings, {p[2]: len(keys) for p, keys in zip(people, chosen, strict=True)}
    )
    tasks: list[Task] = []
    for order, (number, _, subject) in enumerate(people):
        for key in chosen[order]:
            words = (settings.seed, sources[number].name, subject)
            seeds = DrawKeys(
                frame=stable_seed("frame", *words, key.sequence, key.frame),
                sequence=stable_seed("sequence", *words, key.sequence),
                subject=stable_seed("subject", *words),
            )
            tasks.append(
                Task(
                    len(tasks), splits[subject], subject, number, key, seeds,
                    order % settings.devices,
                )
            )  # fmt: skip
    if not tasks:
        raise ConfigError("the plan has no frames: the source has no subjects or no meshes")
    check_plan(tasks)
    return tasks


def check_plan(tasks: list[Task]) -> None:
    """Raise DatasetError if a subject is in two splits or two frames have the same file name."""
    split_of: dict[str, str] = {}
    for task in tasks:
        if split_of.setdefault(task.subject, task.split) != task.split:
            raise DatasetError(
                f"subject {task.subject} is in {task.split} and in {split_of[task.subject]}"
            )
    stem, count = Counter(task.stem for task in tasks).most_common(1)[0]
    if count > 1:
        raise DatasetError(f"{count} frames would be written to {stem}: sequence names collide")
