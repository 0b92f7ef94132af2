"""Chunks, the units of work of a data set, and parts, which are sets of chunks."""

from __future__ import annotations

import hashlib
import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from glsim.core.errors import ConfigError, DatasetError
from glsim.data.record_schema import is_file_name
from glsim.settings.schema import SPLIT_NAMES
from glsim.simulation.plan.tasks import Plan, Task, people_of

#: Frames per chunk, by output format. Chunks are small, so that workers end together and a dead
#: worker loses little. A shard (5 to 100 MB) is one chunk. The numbers are part of the format: with
#: others, shards differ and a partly written data set is rendered again.
CHUNK_FRAMES = {"png": 32, "webdataset": 512}


@dataclass(frozen=True)
class Chunk:
    """A unit of work: tasks of consecutive frames of one split."""

    number: int
    split: str
    order: int
    tasks: Sequence[Task]

    @property
    def shard(self) -> str:
        """File name of the chunk's shard in the format "webdataset"."""
        return f"{self.split}-{self.order:06d}.tar"


@dataclass(frozen=True)
class Part:
    """The chunks of a data set whose number modulo ``of`` equals ``number`` modulo ``of``.

    Parts may be numbered from 0 to ``of`` - 1 or from 1 to ``of``: 0/of is the same as of/of.
    """

    number: int
    of: int

    def chunks(self, count: int) -> range:
        """Return the numbers of this part's chunks, if the data set has ``count`` chunks."""
        return range(self.number % self.of, count, self.of)

    @property
    def name(self) -> str:
        """Name of the part in file names, the same for 0/of and of/of."""
        return f"{self.number % self.of}-of-{self.of}"

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


def parse_part(text: str) -> Part:
    """Parse the text of a part, such as "3/16". Raises ConfigError."""
    match = re.fullmatch(r"(\d{1,9})/([1-9]\d{0,8})", text, re.ASCII)
    if match is None:
        raise ConfigError(f"--part {text}: give the number of the part and of all, such as 3/16")
    number, of = int(match[1]), int(match[2])
    if number > of:
        raise ConfigError(f"--part {text}: parts are numbered 0 to {of - 1}, or from 1")
    return Part(number, of)


class ChunkPlan:
    """The tasks of a data set, sorted by split and cut into chunks.

    The plan depends only on the tasks and the format, not on the workers or on the files on disk.
    Chunks are made on access, so that memory grows with the people, not with their frames. Raises
    DatasetError if files of a split, subject or sequence would lie outside the data set, and if two
    frames would have the same files.
    """

    def __init__(self, tasks: Sequence[Task], chunk_frames: int) -> None:
        self.frames = len(tasks)
        self._tasks, self._chunk_frames = tasks, chunk_frames
        stems = tasks.stems() if isinstance(tasks, Plan) else (task.stem for task in tasks)
        for stem in stems:
            if not is_file_name(stem) or stem.count("/") != 2:
                raise DatasetError(
                    f"{stem!r} does not name a file inside the data set: rename the subject "
                    "or the sequence"
                )
        runs = [(SPLIT_NAMES.index(p.split), p.first, p.frames) for p in people_of(tasks)]
        split, first, count = np.array(runs, np.int64).reshape(-1, 3).T
        order = np.argsort(split, kind="stable")
        #: Index of the first task of each run, by split.
        self._first = first[order]
        #: Position in the data set of each run's first frame; last, the number of all frames.
        self._start = np.concatenate([[0], np.cumsum(count[order])])
        #: For each split: number of frames, position of the first frame, number of the first chunk.
        self._frames = [int(count[split == n].sum()) for n in range(len(SPLIT_NAMES))]
        chunks = [-(-frames // chunk_frames) for frames in self._frames]
        self._before = [sum(self._frames[:n]) for n in range(len(SPLIT_NAMES))]
        self._chunks = [sum(chunks[:n]) for n in range(len(SPLIT_NAMES) + 1)]

    def __len__(self) -> int:
        return self._chunks[-1]

    def __getitem__(self, number: int) -> Chunk:
        split, order, start, stop = self._place(number)
        return Chunk(number, split, order, self._tasks_between(start, stop))

    def __iter__(self) -> Iterator[Chunk]:
        return (self[number] for number in range(len(self)))

    def frames_in(self, number: int) -> int:
        """Count the frames of a chunk, without making their tasks."""
        _, _, start, stop = self._place(number)
        return stop - start

    def split_of(self, number: int) -> str:
        """Return the name of a chunk's split."""
        return self._place(number)[0]

    def _place(self, number: int) -> tuple[str, int, int, int]:
        """Return a chunk's split, its number in the split, and its first and last position."""
        if not 0 <= number < len(self):
            raise IndexError(f"there are {len(self)} chunks, not one at {number}")
        split = bisect_right(self._chunks, number) - 1
        order = number - self._chunks[split]
        start = self._before[split] + order * self._chunk_frames
        end = self._before[split] + self._frames[split]
        return SPLIT_NAMES[split], order, start, min(start + self._chunk_frames, end)

    def _tasks_between(self, start: int, stop: int) -> list[Task]:
        """Return the tasks from position ``start`` to before ``stop`` in the data set."""
        tasks: list[Task] = []
        run = int(np.searchsorted(self._start, start, "right")) - 1
        while start < stop:
            end = min(stop, int(self._start[run + 1]))
            index = int(self._first[run] + start - self._start[run])
            tasks += self._tasks[index : index + end - start]
            start, run = end, run + 1
        return tasks

    def fingerprint(self) -> str:
        """Hash the name, mesh file, seeds and device of every frame."""
        if isinstance(self._tasks, Plan):
            return self._tasks.fingerprint()
        digest = hashlib.blake2b(digest_size=16)
        for chunk in self:
            for task in chunk.tasks:
                words = (task.index, task.stem, task.key.path, *task.seeds, task.device)
                digest.update("\x1f".join(map(str, words)).encode() + b"\n")
        return digest.hexdigest()
