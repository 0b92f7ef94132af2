"""Which pairs are rendered for a training, and in which order: arithmetic, no OpenGL.

The order must not depend on the number of workers, and still each worker must render for itself
and reuse what it has rendered. So the sequence of batches is dealt to a fixed number of lanes,
batch j to lane j % LANES, and each worker has whole lanes. A lane is a row of blocks of a few
batches; all pairs of a block are rendered, then given in ``reuse`` orders, each of them once
through. Everything about batch j follows from its number, so that a training may resume anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from glsim.config import SPLIT_NAMES, Settings
from glsim.distribution import DrawKeys
from glsim.errors import ConfigError, did_you_mean
from glsim.faces.base import FaceSource
from glsim.plan import Task, split_subjects, stable_seed

#: 1, 2, 3, 4, 6 and 12 workers share them evenly.
LANES: Final = 12

#: A block is what a batch is drawn from: so many times larger than the batch that its pairs seldom
#: meet again, so small that the first ones do not keep a training waiting (chosen by experiment:
#: 16 pairs of kinect-v2 are 0.35 s).
BATCHES_A_BLOCK: Final = 4

#: Frames of one person in a row: making a procedural head takes 10 ms, a frame of it 0.2 ms.
FRAMES_A_VISIT: Final = 4


class Place(NamedTuple):
    """Where a batch is: lane, block of the lane, and which pairs of the block."""

    lane: int
    block: int
    pairs: tuple[int, ...]


@dataclass(frozen=True)
class Stream:
    """An endless sequence of batches.

    sources: opened from ``settings``. people: of each source, those of the split.
    """

    settings: Settings
    sources: Sequence[FaceSource]
    people: Sequence[Sequence[str]]
    split: str
    batch: int
    reuse: int
    seed: int

    @property
    def block_pairs(self) -> int:
        """Pairs of a block."""
        return self.batch * BATCHES_A_BLOCK

    def place(self, batch: int) -> Place:
        """Where the batch of this number comes from."""
        turn, lane = divmod(batch, LANES)
        block, within = divmod(turn, BATCHES_A_BLOCK * self.reuse)
        time, part = divmod(within, BATCHES_A_BLOCK)
        rng = np.random.default_rng(stable_seed("order", self.seed, lane, block, time))
        order = rng.permutation(self.block_pairs)
        return Place(
            lane, block, tuple(order[part * self.batch : (part + 1) * self.batch].tolist())
        )

    def tasks(self, lane: int, block: int) -> list[Task]:
        """The pairs of a block, as frames to be made."""
        rng = np.random.default_rng(stable_seed("block", self.seed, lane, block))
        shares = np.array([s.weight or s.count or 1.0 for s in self.settings.source])
        shares[[not names for names in self.people]] = 0
        tasks: list[Task] = []
        while (left := self.block_pairs - len(tasks)) > 0:
            source = int(rng.choice(len(shares), p=shares / shares.sum()))
            names = self.people[source]
            tasks += self._visit(
                source,
                names[int(rng.integers(len(names)))],
                min(left, FRAMES_A_VISIT),
                lane,
                block,
                rng,
            )
        return tasks

    def _visit(
        self,
        source: int,
        subject: str,
        count: int,
        lane: int,
        block: int,
        rng: np.random.Generator,
    ) -> list[Task]:
        """Some frames of one person; the noise and the pose are drawn for this visit alone."""
        settings, name = self.settings, self.sources[source].name
        keys = self.sources[source].frames(subject, settings.source[source].frames_per_subject)
        chosen = rng.choice(len(keys), min(count, len(keys)), replace=False)
        words = (settings.seed, name, subject)
        tasks = []
        for number in chosen:
            key = keys[number]
            draw = int(rng.integers(2**63))
            seeds = DrawKeys(
                frame=stable_seed("simulated", self.seed, lane, block, draw),
                sequence=stable_seed("sequence", *words, key.sequence),
                subject=stable_seed("subject", *words),
            )
            device = int(rng.integers(settings.devices))
            tasks.append(Task(int(number), self.split, subject, source, key, seeds, device))
        return tasks


def people_of(
    settings: Settings, sources: Sequence[FaceSource], split: str
) -> tuple[tuple[str, ...], ...]:
    """The people of a split by source, the same as ``glsim generate`` would put there.

    Raises ConfigError for an unknown or empty split, and for the paper's, which needs the frames.
    """
    if split not in SPLIT_NAMES:
        raise ConfigError(f"no such split {split!r}: {did_you_mean(split, SPLIT_NAMES)}")
    if isinstance(settings.split, str):
        raise ConfigError(
            f"split = {settings.split!r} is one of a finite data set: give three shares to render "
            "pairs while training"
        )
    listed = [
        (number, name, f"{number}-{name}" if len(sources) > 1 else name)
        for number, source in enumerate(sources)
        for name in source.subjects(settings.source[number].subjects)
    ]
    split_of = split_subjects([whole for _, _, whole in listed], settings.split, settings.seed)
    people: list[list[str]] = [[] for _ in sources]
    for number, name, whole in listed:
        if split_of[whole] == split:
            people[number].append(name)
    if not any(people):
        raise ConfigError(f"nobody is in the split {split!r}: give it a share (split = [...])")
    return tuple(map(tuple, people))
