"""The Plan of a data set: its subjects and their splits, and the name and seeds of each frame.

The plan depends only on the settings and reads no geometry: any worker can take any part of it, in
any order, and produces the same frames. A task is computed from the frame's index: the memory grows
with the number of people, not of frames.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import NamedTuple, overload

import numpy as np

from glsim.core.errors import ConfigError, DatasetError, counted
from glsim.core.seeds import device_key, stable_seed
from glsim.faces.face_source import ComputedKeys, FaceKey, FaceSource
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import SPLIT_NAMES, Settings
from glsim.settings.source_settings import SourceSettings
from glsim.simulation.plan.split import split_as_paper, split_subjects


@dataclass(frozen=True)
class Task:
    """One frame to simulate: its name, source, split and seeds.

    Attributes:
        split: train, val or test.
        subject: name in the data set; the source's number precedes it if there are several.
        source: index in ``settings.source``.
        repeat: number of earlier uses of the mesh, if a subject from files has fewer meshes than
            frames. Each use is a sequence of its own, with its own pose, distance and noise.
    """

    index: int
    split: str
    subject: str
    source: int
    key: FaceKey
    seeds: ScopeSeeds
    device: int
    repeat: int = 0

    @property
    def sequence(self) -> str:
        """The sequence's name in the data set."""
        return _sequence(self.key, self.repeat)

    @property
    def stem(self) -> str:
        """Path of the frame's files in the data set, without the ending ``_<layer>.png``."""
        return f"{self.split}/{self.subject}/{self.sequence}_{self.key.frame:05d}"


def _sequence(key: FaceKey, repeat: int) -> str:
    return f"{key.sequence}_r{repeat:03d}" if repeat else key.sequence


class PersonFrames(NamedTuple):
    """The consecutive tasks of one person in a Plan: ``frames`` tasks, from index ``first`` on.

    ``name`` is the person's name in the source; the other fields are those of Task.
    """

    split: str
    subject: str
    source: int
    name: str
    first: int
    frames: int


@dataclass(frozen=True)
class Thinning:
    """A choice of ``count`` evenly spaced frames from the ``total`` frames of a source."""

    total: int
    count: int

    def below(self, position: int) -> int:
        """Count the chosen frames among the first ``position`` frames."""
        return position * self.count // self.total if self.total else 0

    def position(self, number: int) -> int:
        """Return the index, among all frames, of the chosen frame ``number``; both count from 0."""
        return -(-(number + 1) * self.total // self.count) - 1


#: Largest plan of generated faces. dataset.json has 14 bytes for each person and 95 for each shard
#: of 512 frames (measured); these numbers fill its 16 MB.
MAX_PEOPLE, MAX_FRAMES = 500_000, 50_000_000


class Plan(Sequence[Task]):
    """The tasks of a data set, sorted by source, subject and frame, and computed on access."""

    def __init__(self, settings: Settings, sources: Sequence[FaceSource]) -> None:
        """Count the frames of all people. Raises ConfigError like ``make_tasks``."""
        self._settings, self._sources = settings, sources
        self._names: list[str] = []
        self._last: tuple[int, Sequence[FaceKey]] = -1, ()
        numbers: list[int] = []
        frames: list[int] = []
        #: Source -> the arguments from which its keys are computed, if it does not list them.
        self._computed: dict[int, tuple[object, ...]] = {}
        for number, source in enumerate(sources):
            wanted = settings.source[number]
            for name in source.subjects(wanted.subjects):
                keys = source.frames(name, wanted.frames_per_subject)
                self._names.append(name)
                numbers.append(number)
                repeated = wanted.frames_per_subject if source.repeats and keys else None
                frames.append(repeated or len(keys))
                if number not in self._computed and isinstance(keys, ComputedKeys):
                    self._computed[number] = (type(keys).__name__, *keys.words)
        self._source = np.array(numbers, np.int16)
        have = np.array(frames, np.int64)
        available = [int(have[self._source == n].sum()) for n in range(len(sources))]
        counts = image_counts(settings.source, available)
        self._thinned = [Thinning(*both) for both in zip(available, counts, strict=True)]
        #: Index of each person's first frame among all frames of the source, chosen or not.
        self._before = np.zeros(len(have), np.int64)
        chosen = np.zeros(len(have), np.int64)
        for number, thinning in enumerate(self._thinned):
            own = self._source == number
            ends = np.cumsum(have[own])
            self._before[own] = ends - have[own]
            chosen[own] = np.diff(ends * thinning.count // max(1, thinning.total), prepend=0)
        #: Index of each person's first task; the last entry is the number of all tasks.
        self._first = np.concatenate([[0], np.cumsum(chosen)])
        images = dict(zip(map(self._subject, range(len(have))), chosen.tolist(), strict=True))
        if len(images) < len(have):
            raise DatasetError("a source names two of its people alike: rename one")
        if isinstance(settings.split, str):
            splits = split_as_paper(images, settings.seed)
        else:
            splits = split_subjects(list(images), settings.split, settings.seed)
        self._split = np.array([SPLIT_NAMES.index(splits[name]) for name in images], np.uint8)

    def __len__(self) -> int:
        return int(self._first[-1])

    @overload
    def __getitem__(self, index: int) -> Task: ...
    @overload
    def __getitem__(self, index: slice) -> list[Task]: ...
    def __getitem__(self, index: int | slice) -> Task | list[Task]:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        position = index + len(self) if index < 0 else index
        if not 0 <= position < len(self):
            raise IndexError(f"the plan has {counted(len(self), 'frame')}, not one at {index}")
        return self._task(int(np.searchsorted(self._first, position, "right")) - 1, position)

    def __iter__(self) -> Iterator[Task]:
        for person in range(len(self._names)):
            for index in range(int(self._first[person]), int(self._first[person + 1])):
                yield self._task(person, index)

    def _subject(self, person: int) -> str:
        name = self._names[person]
        return f"{self._source[person]}-{name}" if len(self._sources) > 1 else name

    def _keys(self, person: int) -> Sequence[FaceKey]:
        """Return the keys of all frames of a person, before thinning."""
        if self._last[0] != person:
            number = self._source[person]
            count = self._settings.source[number].frames_per_subject
            self._last = person, self._sources[number].frames(self._names[person], count)
        return self._last[1]

    def _task(self, person: int, index: int) -> Task:
        number, subject = int(self._source[person]), self._subject(person)
        thinning, before = self._thinned[number], int(self._before[person])
        chosen = thinning.below(before) + index - int(self._first[person])
        keys = self._keys(person)
        repeat, place = divmod(thinning.position(chosen) - before, len(keys))
        key = keys[place]
        sequence = _sequence(key, repeat)
        words = (self._settings.seed, self._sources[number].name, subject)
        device = person % self._settings.devices
        seeds = ScopeSeeds(
            frame=stable_seed("frame", *words, sequence, key.frame),
            sequence=stable_seed("sequence", *words, sequence),
            subject=stable_seed("subject", *words),
            device=device_key(self._settings.seed, device),
        )
        split = SPLIT_NAMES[self._split[person]]
        return Task(index, split, subject, number, key, seeds, device, repeat)

    def people(self) -> Iterator[PersonFrames]:
        """Yield each person's tasks, in order; people without frames are left out."""
        first = self._first.tolist()
        for person, (start, end) in enumerate(pairwise(first)):
            if start < end:
                split, number = SPLIT_NAMES[self._split[person]], int(self._source[person])
                subject, name = self._subject(person), self._names[person]
                yield PersonFrames(split, subject, number, name, start, end - start)

    def stems(self) -> Iterator[str]:
        """Yield the file stems to check before a run.

        They are the stems of all frames of the people whose keys the source lists. Raises
        DatasetError if two frames have the same stem.
        """
        for split, subject, source, _, first, frames in self.people():
            if source in self._computed:
                yield f"{split}/{subject}/computed_00000"
                continue
            names = Counter(task.stem for task in self[first : first + frames])
            stem, most = names.most_common(1)[0]
            if most > 1:
                raise DatasetError(
                    f"{most} frames would be written to {stem}: sequence names collide"
                )
            yield from names

    def fingerprint(self) -> str:
        """Return a hash that changes with any frame's name, mesh file, seed or device."""
        settings, sources = self._settings, self._sources
        digest = hashlib.blake2b(digest_size=16)

        def add(*words: object) -> None:
            digest.update("\x1f".join(map(str, words)).encode() + b"\n")

        add("plan", settings.seed, settings.devices, *(source.name for source in sources))
        add(*((thinning.total, thinning.count) for thinning in self._thinned))
        add(*self._names)
        for column in (self._source, self._split, self._before, self._first):
            digest.update(column.astype("<i8").tobytes())
        for number, words in self._computed.items():
            add(number, *words)
        for person, number in enumerate(self._source.tolist()):
            if number not in self._computed:
                for key in self._keys(person):
                    add(key.sequence, key.frame, key.path)
        return digest.hexdigest()


def image_counts(sources: Sequence[SourceSettings], available: Sequence[int]) -> list[int]:
    """Compute how many images each source contributes: its count, its weighted share, or all.

    Weighted sources share images in proportion to their weights; the source with the fewest images
    for its weight limits them all. Raises ConfigError for a count above the available images, and
    for a source without weight or count beside a weighted one.
    """
    weighted = any(source.weight for source in sources)
    for number, (source, images) in enumerate(zip(sources, available, strict=True)):
        name = f"source {number} ({source.kind})"
        if source.count is not None and source.count > images:
            raise ConfigError(
                f"{name}: count = {source.count}, but it has {counted(images, 'image')}: lower "
                "count, or raise frames_per_subject"
            )
        if weighted and source.weight is None and source.count is None:
            raise ConfigError(f"{name}: give it a weight or a count, as other sources have")
    pairs = list(zip(sources, available, strict=True))
    total = min((images / s.weight for s, images in pairs if s.weight is not None), default=0.0)
    return [
        s.count or (images if s.weight is None else round(total * s.weight)) for s, images in pairs
    ]


def make_tasks(settings: Settings, sources: Sequence[FaceSource]) -> Plan:
    """Make the Plan. Raises ConfigError for no frames, or for more than a data set can have."""
    for source in settings.source:
        people, each = source.subjects or 1, source.frames_per_subject or 1
        if people > MAX_PEOPLE or people * each > MAX_FRAMES:
            raise ConfigError(
                f"{people} subjects of {each} frames are {people * each} frames; one data set "
                f"has at most {MAX_FRAMES} of {MAX_PEOPLE} people: make several, with other seeds"
            )
    plan = Plan(settings, sources)
    if not len(plan):
        raise ConfigError("the plan has no frames: the source has no subjects or no meshes")
    return plan


def people_of(tasks: Sequence[Task]) -> Iterator[PersonFrames]:
    """Yield each person's consecutive tasks in a Plan or a list of tasks."""
    if isinstance(tasks, Plan):
        yield from tasks.people()
        return
    first = 0
    for place, run in groupby(tasks, lambda t: (t.split, t.subject, t.source, t.key.subject)):
        count = sum(1 for _ in run)
        yield PersonFrames(*place, first, count)
        first += count
