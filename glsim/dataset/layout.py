"""Names of files in a data set, and how the plan is cut into units of work.

    dataset.json                     header: settings, sensor, counts, checks of the files below
    manifest.jsonl                   one record a frame, by split and then in the plan's order
    skipped.jsonl                    frames that could not be made, and why
    train|val|test/<subject>/<sequence>_<frame>_<layer>.png     format "png"
    train|val|test/metadata.jsonl    the same for the image-folder loader of Hugging Face
    train-000000.tar ...             format "webdataset": <index>.<layer>.png, <index>.json
    .glsim/                          lock, plan, chunk records, temporary files; not data

<index> is the frame's position in the plan, eight digits.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from glsim.config import SPLIT_NAMES
from glsim.plan import Task

FORMAT = "glsim"
#: Raised when readers of the old version would misread the new one.
FORMAT_VERSION = 1

HEADER = "dataset.json"
MANIFEST = "manifest.jsonl"
SKIPPED = "skipped.jsonl"
METADATA = "metadata.jsonl"
STATE = ".glsim"

#: Frames in a unit of work. Small enough that two workers end together and that little is lost
#: when one dies; for shards also the frames in a file (5 to 100 MB). Part of the format: other
#: numbers give other shards and would render a begun data set anew.
CHUNK_FRAMES = {"png": 32, "webdataset": 512}


@dataclass(frozen=True)
class Chunk:
    """A unit of work: consecutive frames of one split.

    number: position among all chunks. order: position among those of the split.
    """

    number: int
    split: str
    order: int
    tasks: Sequence[Task]

    @property
    def shard(self) -> str:
        """The name of the shard that holds these frames in the format "webdataset"."""
        return f"{self.split}-{self.order:06d}.tar"


class Plan:
    """All frames of a data set, by split and then in the order of the tasks, cut into chunks.

    A function of the tasks and of the format alone: not of workers, and not of what is on disk.
    """

    def __init__(self, tasks: Sequence[Task], chunk_frames: int) -> None:
        self.frames = len(tasks)
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
        """Changes with every frame's name, mesh file, seed and device."""
        digest = hashlib.blake2b(digest_size=16)
        for task in self._tasks:
            words = (task.index, task.stem, task.key.path, *task.seeds, task.device)
            digest.update("\x1f".join(map(str, words)).encode() + b"\n")
        return digest.hexdigest()
