"""Chunks: how the planned frames of a data set are cut into units of work."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from glsim.dataset.schema import is_file_name
from glsim.errors import DatasetError
from glsim.plan.tasks import Task
from glsim.settings.schema import SPLIT_NAMES

#: Frames per chunk, by output format. Chunks are small enough that two workers end together and
#: that little is lost when one dies; a shard (5 to 100 MB) is one chunk. The numbers are part of
#: the format: with others, shards differ and a partly written data set is rendered again.
CHUNK_FRAMES = {"png": 32, "webdataset": 512}


@dataclass(frozen=True)
class Chunk:
    """A unit of work: consecutive frames of one split.

    number: position among all chunks. order: position among the chunks of the split.
    """

    number: int
    split: str
    order: int
    tasks: Sequence[Task]

    @property
    def shard(self) -> str:
        """The name of the shard that holds these frames in the format "webdataset"."""
        return f"{self.split}-{self.order:06d}.tar"


class ChunkPlan:
    """All frames of a data set, by split and then in the order of the tasks, cut into chunks.

    It depends only on the tasks and the format, not on the workers or on the files on disk. Raises
    DatasetError for a split, subject or sequence whose files would lie outside the data set.
    """

    def __init__(self, tasks: Sequence[Task], chunk_frames: int) -> None:
        self.frames = len(tasks)
        for task in tasks:
            if not is_file_name(task.stem) or task.stem.count("/") != 2:
                raise DatasetError(
                    f"{task.stem!r} does not name a file inside the data set: rename the subject "
                    "or the sequence"
                )
        self._tasks = [task for split in SPLIT_NAMES for task in tasks if task.split == split]
        self._bounds: list[tuple[str, int, int, int]] = []
        first = 0
        for split in SPLIT_NAMES:
            count = sum(task.split == split for task in tasks)
            for order, start in enumerate(range(first, first + count, chunk_frames)):
                stop = min(start + chunk_frames, first + count)
                self._bounds.append((split, order, start, stop))
            first += count

    def __len__(self) -> int:
        return len(self._bounds)

    def __getitem__(self, number: int) -> Chunk:
        split, order, start, stop = self._bounds[number]
        return Chunk(number, split, order, self._tasks[start:stop])

    def __iter__(self) -> Iterator[Chunk]:
        return (self[number] for number in range(len(self)))

    def fingerprint(self) -> str:
        """Return a hash that changes with every frame's name, mesh file, seed and device."""
        digest = hashlib.blake2b(digest_size=16)
        for task in self._tasks:
            words = (task.index, task.stem, task.key.path, *task.seeds, task.device)
            digest.update("\x1f".join(map(str, words)).encode() + b"\n")
        return digest.hexdigest()
