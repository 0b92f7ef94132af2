"""Plan of the pairs that a training renders: their people, order and images (without PyTorch).

The order must not depend on the number of workers, and each worker can reuse only pairs that it has
rendered. So batch j belongs to lane j % LANES, and each worker has whole lanes. A lane is a
sequence of blocks of a few batches. All pairs of a block are rendered, then used ``reuse`` times,
each time in a new order. Batch j follows from its number, so a training may resume anywhere.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import FrameKey
from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import ConfigError, MeshError, did_you_mean
from glsim.core.seeds import device_key, pcg_rng, stable_seed
from glsim.faces.face_source import FaceSource
from glsim.networks.inputs import DEPTH_ALONE, NetworkInputs, stack_inputs
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import SPLIT_NAMES, Settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.split import split_subjects
from glsim.simulation.plan.tasks import Task
from glsim.train.data.checks import Target, moved_pair
from glsim.train.data.extra_inputs import Neighbours, vary_inputs

log = logging.getLogger(__name__)

#: Number of lanes; 1, 2, 3, 4, 6 and 12 workers share them evenly.
LANES: Final = 12
#: Number of different batches in a block. With this number, two pairs seldom share a batch twice,
#: and training starts soon (measured: 16 pairs of kinect-v2 take 0.35 s).
BATCHES_PER_BLOCK: Final = 4
#: Number of successive frames of a sequence, for networks with neighbours in time.
FRAMES_PER_RUN: Final = 8
#: Number of successive frames of a person: a new procedural head takes 10 ms, a frame more 0.2 ms.
FRAMES_PER_VISIT: Final = 4


class BatchPlace(NamedTuple):
    """Position of a batch: lane, number of the block in its lane, and pairs of the block."""

    lane: int
    block: int
    pairs: tuple[int, ...]


@dataclass(frozen=True)
class BatchStream:
    """Plan of an endless sequence of batches.

    For neighbours in time, frames of a person are consecutive frames of one sequence and device.

    ``people``: names of the split's people, for each source.
    """

    settings: Settings
    sources: Sequence[FaceSource]
    people: Sequence[Sequence[str]]
    split: str
    batch: int
    reuse: int
    seed: int
    inputs: NetworkInputs = DEPTH_ALONE
    vary: bool = False
    target: Target = "clean"
    protocol: DepthProtocol = "depth"
    backend: str | None = None

    @property
    def block_pairs(self) -> int:
        """Number of pairs in a block."""
        return self.batch * BATCHES_PER_BLOCK

    def place(self, batch: int) -> BatchPlace:
        """Return the position of batch number n."""
        turn, lane = divmod(batch, LANES)
        block, within = divmod(turn, BATCHES_PER_BLOCK * self.reuse)
        use, number = divmod(within, BATCHES_PER_BLOCK)
        rng = pcg_rng("order", self.seed, lane, block, use)
        pairs = rng.permutation(self.block_pairs)[number * self.batch : (number + 1) * self.batch]
        return BatchPlace(lane, block, tuple(pairs.tolist()))

    def tasks(self, lane: int, block: int) -> list[Task]:
        """Draw the frames to render for a block."""
        rng = pcg_rng("block", self.seed, lane, block)
        shares = np.array([s.weight or s.count or 1.0 for s in self.settings.source])
        shares[[not names for names in self.people]] = 0
        tasks: list[Task] = []
        most = FRAMES_PER_RUN if self.inputs.temporal else FRAMES_PER_VISIT
        while (left := self.block_pairs - len(tasks)) > 0:
            source = int(rng.choice(len(shares), p=shares / shares.sum()))
            names = self.people[source]
            name = names[int(rng.integers(len(names)))]
            tasks += self._visit(source, name, min(left, most), lane, block, rng)
        return tasks

    def _visit(
        self, source: int, subject: str, count: int, lane: int, block: int, rng: np.random.Generator
    ) -> list[Task]:
        """Draw frames of a person for one block, with new seeds for noise and pose."""
        settings, name = self.settings, self.sources[source].name
        keys = self.sources[source].frames(subject, settings.source[source].frames_per_subject)
        chosen: Sequence[int]
        if self.inputs.temporal:
            first = int(rng.integers(len(keys)))
            sequence = keys[first].sequence
            run = keys[first : first + count]
            chosen = range(first, first + sum(key.sequence == sequence for key in run))
        else:
            drawn = rng.choice(len(keys), min(count, len(keys)), replace=False)
            chosen = [int(number) for number in drawn]
        of_visit = int(rng.integers(settings.devices)) if self.inputs.temporal else None
        identity = (settings.seed, name, subject)
        tasks = []
        for number in chosen:
            key = keys[number]
            draw = int(rng.integers(2**63))
            device = int(rng.integers(settings.devices)) if of_visit is None else of_visit
            seeds = ScopeSeeds(
                frame=stable_seed("simulated", self.seed, lane, block, draw),
                sequence=stable_seed("sequence", *identity, key.sequence),
                subject=stable_seed("subject", *identity),
                device=device_key(settings.seed, device),
            )
            tasks.append(Task(number, self.split, subject, source, key, seeds, device))
        return tasks

    def images(
        self, results: Sequence[Frame | Skipped], lane: int, block: int
    ) -> list[NDArray[np.float32]]:
        """Convert the frames of a block to images, (C + 1, H, W) each: inputs, then the target.

        Raises MeshError if no frame could be rendered.
        """
        frames = replace_skipped(results)
        depths = ("noisy_mm", f"{self.target}_mm")
        pairs = [[measured.layer(n) for n in depths] for measured in map(Frame.measured, frames)]
        names = [(f"{f.source}/{f.key.subject}", f.key.sequence, f.key.frame) for f in frames]
        keys = [FrameKey(*name) for name in names]
        neighbours = Neighbours(keys, self.inputs)
        rng = pcg_rng("inputs", self.seed, lane, block)
        images = []
        for number, (noisy_mm, target_mm) in enumerate(pairs):
            before, after = ([pairs[n][0] for n in side] for side in neighbours.of(number))
            stack = stack_inputs(self.inputs, noisy_mm, before, after)
            if self.vary:
                stack = vary_inputs(stack, self.inputs, rng)
            pair = np.concatenate([stack, target_mm[None]])
            images.append(moved_pair(pair) if self.protocol == "paper" else pair)
        return images


def replace_skipped(results: Sequence[Frame | Skipped]) -> list[Frame]:
    """Replace each skipped frame by the next rendered frame. Raises MeshError if there is none."""
    good = [number for number, result in enumerate(results) if isinstance(result, Frame)]
    bad = [result for result in results if isinstance(result, Skipped)]
    if not good:
        raise MeshError(
            f"none of {len(results)} faces can be rendered, e.g. {bad[0].key}: {bad[0].why}"
        )
    for result in bad:
        log.warning("%s: skipped and replaced by another: %s", result.key.subject, result.why)
    frames = []
    for number in range(len(results)):
        frame = results[min((other for other in good if other >= number), default=good[0])]
        assert isinstance(frame, Frame)
        frames.append(frame)
    return frames


def split_people(
    settings: Settings, sources: Sequence[FaceSource], split: str
) -> tuple[tuple[str, ...], ...]:
    """List the people of a split for each source; ``glsim generate`` makes the same split.

    Raises ConfigError for an unknown or empty split, and for the split "paper", which needs frames.
    """
    if split not in SPLIT_NAMES:
        raise ConfigError(f"no such split {split!r}: {did_you_mean(split, SPLIT_NAMES)}")
    if isinstance(settings.split, str):
        raise ConfigError(
            f"split = {settings.split!r} needs a finite data set: give three shares to render "
            "pairs while training"
        )
    subjects = [
        (number, name, f"{number}-{name}" if len(sources) > 1 else name)
        for number, source in enumerate(sources)
        for name in source.subjects(settings.source[number].subjects)
    ]
    split_of = split_subjects([unique for _, _, unique in subjects], settings.split, settings.seed)
    people: list[list[str]] = [[] for _ in sources]
    for number, name, unique in subjects:
        if split_of[unique] == split:
            people[number].append(name)
    if not any(people):
        raise ConfigError(f"nobody is in the split {split!r}: give it a share (split = [...])")
    return tuple(map(tuple, people))
