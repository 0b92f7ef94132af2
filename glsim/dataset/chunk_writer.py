"""Render and write chunks, in a worker process or, if there are no workers, in the driver."""

from __future__ import annotations

import io
import tarfile
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import IO, Any, Protocol, cast

from glsim.dataset.chunks import Chunk
from glsim.dataset.identity import Inputs
from glsim.dataset.output_folder import OutputFolder
from glsim.dataset.records import ChunkRecord, ChunkSummary, Record, frame_record, skipped_record
from glsim.errors import DepthRangeError, GlsimError, MeshError
from glsim.files.atomic import AtomicFile, checksum, to_json, wrap_write_errors, write_atomic
from glsim.files.png import encode_png
from glsim.frame import Frame, Skipped
from glsim.plan.tasks import Task
from glsim.settings.schema import Settings


class FrameMaker(Protocol):
    """A function that makes frames, such as ``glsim.pipeline.simulate``; picklable by its name.

    It yields one result per task, in order. It takes tasks as it needs them, and may take a bounded
    number in advance: a request beyond the current chunk makes the iterable fetch the next chunk.
    """

    def __call__(self, settings: Settings, tasks: Iterable[Task], /) -> Iterator[Frame | Skipped]:
        """Yield a Frame per task, or Skipped if it cannot be made."""
        ...


@dataclass(frozen=True)
class RenderJob:
    """What all workers of a run share: settings, output folder, simulator.

    inputs: the driver's, for workers on other machines, whose files may be others.
    """

    settings: Settings
    folder: OutputFolder
    make_frames: FrameMaker
    inputs: Inputs | None = None


@dataclass(frozen=True)
class ChunkProgress:
    """The number of frames of a chunk that are done so far."""

    chunk: int
    frames: int


ChunkEvent = ChunkProgress | ChunkSummary


def render_chunks(job: RenderJob, chunks: Iterable[Chunk]) -> Iterator[ChunkEvent]:
    """Render and write chunks. A ChunkSummary reports that a chunk and its record are complete.

    A frame that cannot be made, or has a depth beyond 16 bits, is recorded as skipped.

    Raises MeshError at the first skipped frame if the settings are strict, DatasetError if a file
    cannot be written, GlsimError if the simulator omits a result, and errors of the simulator.
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
                    yield ChunkProgress(chunk.number, done)
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
    def __init__(self, job: RenderJob, chunk: Chunk) -> None:
        self._settings = job.settings
        self._chunk = chunk
        self._folder = job.folder
        self._frames: list[str] = []
        self._skipped: list[str] = []
        self._bytes = 0
        kind = _ShardSink if job.settings.output.format == "webdataset" else _FolderSink
        self.sink: _FolderSink | _ShardSink = kind(self._folder, chunk)

    def add(self, task: Task, result: Frame | Skipped) -> None:
        if isinstance(result, Skipped):
            self._skip(task, result)
            return
        layers: tuple[str, ...] = self._settings.output.layers
        try:
            images = {layer: encode_png(result.image(layer)) for layer in layers}
        except DepthRangeError as error:  # one far pixel, beyond 16 bits, does not end the set
            self._skip(task, Skipped(result.key, result.source, str(error)))
            return
        files = {layer: self.sink.add(task, layer, data) for layer, data in images.items()}
        record = frame_record(task, result, files)
        text = to_json(record, task.stem)
        self.sink.add_record(task, text)
        self._frames.append(text + "\n")
        self._bytes += sum(len(data) for data in images.values())

    def _skip(self, task: Task, skipped: Skipped) -> None:
        if self._settings.strict:
            raise MeshError(f"{task.stem}: {skipped.why} (strict stops at the first bad frame)")
        self._skipped.append(to_json(skipped_record(task, skipped), task.stem) + "\n")

    def finish(self) -> ChunkSummary:
        summary = ChunkSummary(
            self._chunk.number,
            len(self._frames),
            len(self._skipped),
            self._bytes,
            self.sink.shard,
        )
        record = ChunkRecord(summary, self._frames, self._skipped)
        self._folder.flush_images(record)
        self._folder.save_chunk(record)
        return summary


class _FolderSink:
    """Write every image as its own file."""

    shard = None

    def __init__(self, folder: OutputFolder, chunk: Chunk) -> None:
        self._folder = folder
        self._created: set[str] = set()

    def __enter__(self) -> _FolderSink:
        return self

    def __exit__(self, *_: object) -> None: ...

    def add(self, task: Task, layer: str, data: bytes) -> Record:
        name = f"{task.stem}_{layer}.png"
        path = self._folder.out / name
        parent = name.rpartition("/")[0]
        if parent not in self._created:
            with wrap_write_errors(path.parent):
                path.parent.mkdir(parents=True, exist_ok=True)
            self._created.add(parent)
        temporary = self._folder.temporary_path()
        return {"name": name} | write_atomic(data, path, temporary=temporary, sync=False)

    def add_record(self, task: Task, text: str) -> None:
        """Do nothing: the record is in the manifest only."""


class _ShardSink:
    """Write the images of a chunk to one tar file, in the layout of the library webdataset.

    The key of a member is the index: that library cuts names at the first dot, and the name of a
    sequence may contain one.
    """

    def __init__(self, folder: OutputFolder, chunk: Chunk) -> None:
        self._name = chunk.shard
        path = folder.out / self._name
        self._file = AtomicFile(path, folder.temporary_path(self._name), sync=False)
        self._tar = tarfile.TarFile(
            mode="w", fileobj=cast("IO[bytes]", self._file), format=tarfile.USTAR_FORMAT
        )

    def __enter__(self) -> _ShardSink:
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
    def shard(self) -> Record:
        """The name and checksum of the shard."""
        return {"name": self._name} | self._file.checksum

    def add(self, task: Task, layer: str, data: bytes) -> Record:
        member = f"{task.index:08d}.{layer}.png"
        offset = self._add(member, data)
        return {"name": self._name, "member": member, "offset": offset} | checksum(data)

    def add_record(self, task: Task, text: str) -> None:
        self._add(f"{task.index:08d}.json", text.encode())

    def _add(self, member: str, data: bytes) -> int:
        """Append a member with fixed attributes; return the offset of its data, bytes."""
        info = tarfile.TarInfo(member)
        info.size = len(data)
        info.mode = 0o644
        offset = self._file.size + tarfile.BLOCKSIZE
        self._tar.addfile(info, io.BytesIO(data))
        return offset
