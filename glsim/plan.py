"""Which frames a data set has: subjects, their split, every frame's name and seed.

The plan is a function of the settings alone and costs no geometry, so that any worker can take any
part of it, in any order, and produce the same frames.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from glsim.config import SPLIT_NAMES, Settings
from glsim.distribution import DrawKeys
from glsim.errors import ConfigError, DatasetError
from glsim.faces.base import FaceKey, FaceSource
from glsim.mixture import mixed
from glsim.papersplit import split_as_paper
from glsim.stable import stable_seed

__all__ = ["Task", "check_plan", "make_tasks", "split_subjects", "stable_seed"]


@dataclass(frozen=True)
class Task:
    """One frame to be made.

    index: position in the data set. split: train, val or test.
    subject: the name in the data set (with the source's number in front if there are several).
    source: position in ``settings.source``. key: the frame's name in that source.
    seeds: of the frame, its sequence and its subject. device: number of the virtual device.
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
        """The path of the frame's files in the data set without ``_layer.png``."""
        return f"{self.split}/{self.subject}/{self.key.sequence}_{self.key.frame:05d}"


def make_tasks(settings: Settings, sources: list[FaceSource]) -> list[Task]:
    """The whole plan, ordered by source, subject and frame. Raises ConfigError if it is empty."""
    people: list[tuple[int, str, str]] = []
    for number, source in enumerate(sources):
        for name in source.subjects(settings.source[number].subjects):
            people.append((number, name, f"{number}-{name}" if len(sources) > 1 else name))
    frames = [
        (number, sources[number].frames(name, settings.source[number].frames_per_subject))
        for number, name, _ in people
    ]
    taken = mixed(settings.source, frames)
    splits = _splits(settings, {p[2]: len(keys) for p, keys in zip(people, taken, strict=True)})
    tasks: list[Task] = []
    for order, (number, _, subject) in enumerate(people):
        for key in taken[order]:
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


def _splits(settings: Settings, frames: dict[str, int]) -> dict[str, str]:
    if isinstance(settings.split, str):
        return split_as_paper(frames, settings.seed)
    return split_subjects(list(frames), settings.split, settings.seed)


def split_subjects(
    subjects: list[str], shares: tuple[float, float, float], seed: int
) -> dict[str, str]:
    """Subject -> split, by the largest remainder of the shares over a seeded order of subjects.

    With at least as many subjects as non-zero shares, no wanted split stays empty.
    """
    wanted = [share * len(subjects) for share in shares]
    counts = [int(w) for w in wanted]
    by_remainder = sorted(range(len(shares)), key=lambda s: (counts[s] - wanted[s], s))
    for s in by_remainder[: len(subjects) - sum(counts)]:
        counts[s] += 1
    nonzero = [s for s in range(len(shares)) if shares[s] > 0]
    if len(subjects) >= len(nonzero):
        for s in nonzero:
            if counts[s] == 0:
                counts[counts.index(max(counts))] -= 1
                counts[s] = 1
    order = sorted(subjects, key=lambda name: stable_seed("split", seed, name))
    names = [SPLIT_NAMES[s] for s in range(len(shares)) for _ in range(counts[s])]
    return dict(zip(order, names, strict=True))


def check_plan(tasks: list[Task]) -> None:
    """Prove that no subject is in two splits and that no two frames share a file. DatasetError."""
    split_of: dict[str, str] = {}
    for task in tasks:
        if split_of.setdefault(task.subject, task.split) != task.split:
            raise DatasetError(
                f"subject {task.subject} is in {task.split} and in {split_of[task.subject]}"
            )
    stem, count = Counter(task.stem for task in tasks).most_common(1)[0]
    if count > 1:
        raise DatasetError(f"{count} frames would be written to {stem}: sequence names collide")
