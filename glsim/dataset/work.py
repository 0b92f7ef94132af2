"""Rendering chunks and writing them: what a worker process does, and the parent if it is alone."""

from __future__ import annotations

import io
import tarfile
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol, cast

from glsim.config import Settings
from glsim.dataset.files import CheckedFile, check_bytes, to_json, write_file, writing
from glsim.dataset.layout import Chunk
from glsim.dataset.png import encode_png
from glsim.dataset.record import ChunkRecord, ChunkSummary, Record, frame_record, skipped_record
from glsim.dataset.store import Store
from glsim.errors import GlsimError, MeshError
from glsim.frame import Frame, Skipped
from glsim.plan import Task


class FrameMaker(Protocol):
    """Makes frames, such as ``glsim.pipeline.simulate``; picklable, by the name of its module.

    One result a task, in order. It takes tasks as it needs them and may run a bounded number of
    them ahead: the iterable hands out the next chunk of work when it is asked for more.
    """

    def __call__(self, settings: Settings, tasks: Iterable[Task], /) -> Iterator[Frame | Skipped]:
        """Frames, and Skipped for those that cannot be made."""
        ...


@dataclass(frozen=True)
class Job:
    """What a worker needs to know, besides its chunks."""

    settings: Settings
    out: Path
    make_frames: FrameMaker


@dataclass(frozen=True)
class Started:
    """So many frames of a chunk are done."""

    chunk: int
    frames: int


Event = Started | ChunkSummary


def render(job: Job, chunks: Iterable[Chunk]) -> Iterator[Event]:
    """Make and write chunks. A ChunkSummary says that a chunk is complete, its record included.

    Raises MeshError at the first skipped frame if the settings are strict, DatasetError if
    something cannot be written, GlsimError if the simulator breaks its promises, and whatever
    the simulator raises.
    """
    chunks = iter(chunks)
    taken: deque[Chunk] = deque()

    def tasks() -> Iterator[Task]:
        for chunk in chunks:
            taken.append(chunk)
            yield from chunk.tasks

    results = iter(job.make_frames(job.settings, tasks()))
    try:
        for first in results:
            chunk = taken.popleft()
            writer = _ChunkWriter(job, chunk)
            with writer.sink:
                result: Frame | Skipped | None = first
                for done, task in enumerate(chunk.tasks, start=1):
                    if result is None or result.key != task.key:
                        raise GlsimError(f"the simulator gave no result for {task.stem}")
                    writer.add(task, result)
                    yield Started(chunk.number, done)
                    if done < len(chunk.tasks):
                        result = next(results, None)
            yield writer.finish()
        forgotten = taken[0] if taken else next(chunks, None)
        if forgotten is not None:
            raise GlsimError(f"the simulator gave no result for {forgotten.tasks[0].stem}")
    finally:
        close = getattr(results, "close", None)
        if close is not None:
            close()


class _ChunkWriter:
    def __init__(self, job: Job, chunk: Chunk) -> None:
        self._settings = job.settings
        self._chunk = chunk
        self._store = Store(job.out)
        self._frames: list[str] = []
        self._skipped: list[str] = []
        self._bytes = 0
        kind = _Shard if job.settings.output.format == "webdataset" else _Folder
        self.sink: _Folder | _Shard = kind(self._store, chunk)

    def add(self, task: Task, result: Frame | Skipped) -> None:
        if isinstance(result, Skipped):
            if self._settings.strict:
                raise MeshError(f"{task.stem}: {result.why} (strict stops at the first bad mesh)")
            self._skipped.append(to_json(skipped_record(task, result), task.stem) + "\n")
            return
        layers: tuple[str, ...] = self._settings.output.layers
        images = {layer: encode_png(result.image(layer)) for layer in layers}
        files = {layer: self.sink.add(task, layer, data) for layer, data in images.items()}
        record = frame_record(task, result, files)
        text = to_json(record, task.stem)
        self.sink.add_record(task, text)
        self._frames.append(text + "\n")
        self._bytes += sum(len(data) for data in images.values())

    def finish(self) -> ChunkSummary:
        summary = ChunkSummary(
            self._chunk.number,
            len(self._frames),
            len(self._skipped),
            self._bytes,
            self.sink.check,
        )
        self._store.save(ChunkRecord(summary, self._frames, self._skipped))
        return summary


class _Folder:
    """Every image is a file of its own."""

    check = None

    def __init__(self, store: Store, chunk: Chunk) -> None:
        self._store = store
        self._folders: set[str] = set()

    def __enter__(self) -> _Folder:
        return self

    def __exit__(self, *_: object) -> None: ...

    def add(self, task: Task, layer: str, data: bytes) -> Record:
        name = f"{task.stem}_{layer}.png"
        path = self._store.out / name
        folder = name.rpartition("/")[0]
        if folder not in self._folders:
            with writing(path.parent):
                path.parent.mkdir(parents=True, exist_ok=True)
            self._folders.add(folder)
        return {"name": name} | write_file(path, data, self._store.temporary())

    def add_record(self, task: Task, text: str) -> None:
        """The record is in the manifest alone."""


class _Shard:
    """The images of a chunk go to one tar file, in the layout of the library webdataset.

    Members carry the index as their key: that library cuts names at the first dot, which a
    sequence's name may have.
    """

    def __init__(self, store: Store, chunk: Chunk) -> None:
        self._name = chunk.shard
        path = store.out / self._name
        self._file = CheckedFile(path, store.temporary(self._name))
        self._tar = tarfile.TarFile(
            mode="w", fileobj=cast("IO[bytes]", self._file), format=tarfile.USTAR_FORMAT
        )

    def __enter__(self) -> _Shard:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if kind is None:
            try:
                self._tar.close()
            except BaseException as failure:
                self._file.__exit__(type(failure), failure, failure.__traceback__)
                raise
        self._file.__exit__(kind, error, trace)

    @property
    def check(self) -> Record:
        return {"name": self._name} | self._file.check

    def add(self, task: Task, layer: str, data: bytes) -> Record:
        member = f"{task.index:08d}.{layer}.png"
        offset = self._add(member, data)
        crc32 = check_bytes(data)
        return {"name": self._name, "member": member, "offset": offset} | crc32

    def add_record(self, task: Task, text: str) -> None:
        self._add(f"{task.index:08d}.json", text.encode())

    def _add(self, member: str, data: bytes) -> int:
        """Append; returns where in the shard the data begin. All but name and size is fixed."""
        info = tarfile.TarInfo(member)
        info.size = len(data)
        info.mode = 0o644
        offset = self._file.size + tarfile.BLOCKSIZE
        self._tar.addfile(info, io.BytesIO(data))
        return offset
