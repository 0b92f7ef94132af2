"""Rendering and writing of chunks, in a worker process or in the driver itself."""

from __future__ import annotations

import io
import tarfile
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from typing import IO, Protocol, cast

from glsim.core.errors import ConfigError, DepthRangeError, GlsimError, MeshError
from glsim.core.files.atomic import AtomicFile, checksum, to_json
from glsim.core.files.store import Store
from glsim.data.chunks import Chunk
from glsim.data.code_version import code_version
from glsim.data.layer_images import layer_png
from glsim.data.records import ChunkRecord, ChunkSummary, Record, frame_record, skipped_record
from glsim.data.run_identity import InputHashes
from glsim.data.state_folder import RunState
from glsim.data.worker_processes import Interim
from glsim.settings.schema import Settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.tasks import Task


class FrameMaker(Protocol):
    """The protocol of a function that makes frames of tasks, such as ``pipeline.simulate``.

    It may take some tasks in advance: a request beyond the current chunk fetches the next chunk.
    """

    def __call__(self, settings: Settings, tasks: Iterable[Task], /) -> Iterator[Frame | Skipped]:
        """Yield a Frame per task, in order, or a Skipped for a task that fails."""
        ...


@dataclass(frozen=True)
class RenderJob:
    """The job of all workers of a run: render, write and record chunks.

    ``inputs``: hashes of the driver's input files; other machines compare theirs with them.
    ``sensor``: the sensor that images state; "" for recorded frames.
    """

    settings: Settings
    state: RunState
    make_frames: FrameMaker
    inputs: InputHashes | None = None
    sensor: str = ""
    code: str = field(default_factory=code_version)

    def run(self, chunks: Iterable[Chunk]) -> Iterator[ChunkEvent]:
        """Render, write and record chunks; yield progress. Raises errors of ``write_chunks``."""
        if code_version() != self.code:
            raise ConfigError(f"glsim was changed during the run, {self.code}: run it again")
        for event in write_chunks(self, self.state.store, chunks):
            if isinstance(event, ChunkRecord):
                self.state.save_chunk(event)
                yield event.summary
            else:
                yield event

    def doing(self, chunk: Chunk) -> str:
        """Describe the rendering of a chunk, for messages, by the chunk's first frame."""
        return f"rendering {chunk.tasks[0].stem} and the next frames"


@dataclass(frozen=True)
class ChunkProgress(Interim):
    """A message with the number of a chunk's finished frames, and a node's CPU seconds for them."""

    chunk: int
    frames: int
    cpu_s: float = 0.0


ChunkEvent = ChunkProgress | ChunkSummary


def write_chunks(
    job: RenderJob, store: Store, chunks: Iterable[Chunk]
) -> Iterator[ChunkProgress | ChunkRecord]:
    """Render chunks and write their images; yield progress and each complete chunk's record.

    A frame that cannot be made, or has a depth beyond 16 bits, is recorded as skipped.

    Raises:
        MeshError: at the first skipped frame if the settings are strict.
        DatasetError: a file cannot be written.
        GlsimError: the simulator omits a frame, or raises an error.
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
            writer = _ChunkWriter(job.settings, store, chunk, job.sensor)
            with writer.opened():
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
        if (close := getattr(results, "close", None)) is not None:
            close()


class _ChunkWriter:
    """A writer of a chunk's frames, as one file per image or as one shard for all."""

    def __init__(self, settings: Settings, store: Store, chunk: Chunk, sensor: str) -> None:
        self._settings, self._store, self._chunk, self._sensor = settings, store, chunk, sensor
        self._frames: list[str] = []
        self._skipped: list[str] = []
        self._bytes = 0
        self._shard: _Shard | None = None

    def opened(self) -> AbstractContextManager[None]:
        """Open the shard (if the format has shards) for a block that adds frames."""
        return self._open_shard() if self._settings.output.format == "webdataset" else nullcontext()

    @contextmanager
    def _open_shard(self) -> Iterator[None]:
        name = self._chunk.shard
        with self._store.create(name, sync=False) as file:
            stream = cast("IO[bytes]", file)
            with tarfile.TarFile(mode="w", fileobj=stream, format=tarfile.USTAR_FORMAT) as tar:
                self._shard = _Shard(name, file, tar)
                yield

    def add(self, task: Task, result: Frame | Skipped) -> None:
        if isinstance(result, Skipped):
            self._skip(task, result)
            return
        layers: tuple[str, ...] = self._settings.output.layers
        try:
            images = {layer: layer_png(result, layer, self._sensor) for layer in layers}
        except DepthRangeError as error:  # one pixel too far for 16 bits must not end the run
            self._skip(task, Skipped(result.key, result.source, str(error)))
            return
        files = {layer: self._write(task, layer, data) for layer, data in images.items()}
        text = to_json(frame_record(task, result, files), task.stem)
        if self._shard is not None:
            self._shard.add(f"{task.index:08d}.json", text.encode())
        self._frames.append(text + "\n")
        self._bytes += sum(len(data) for data in images.values())

    def _write(self, task: Task, layer: str, data: bytes) -> Record:
        if self._shard is not None:
            return self._shard.add(f"{task.index:08d}.{layer}.png", data)
        name = _image_name(task, layer)
        return {"name": name} | self._store.put(name, data, sync=False)

    def _skip(self, task: Task, skipped: Skipped) -> None:
        if self._settings.strict:
            raise MeshError(f"{task.stem}: {skipped.why} (strict=true stops here)")
        self._skipped.append(to_json(skipped_record(task, skipped), task.stem) + "\n")
        if self._shard is None:
            # An earlier run, whose chunks were discarded, may have left images of this frame.
            names = [_image_name(task, layer) for layer in self._settings.output.layers]
            self._store.delete(name for name in names if self._store.checksum(name) is not None)

    def finish(self) -> ChunkRecord:
        frames, skipped = len(self._frames), len(self._skipped)
        shard = None if self._shard is None else self._shard.record
        summary = ChunkSummary(self._chunk.number, frames, skipped, self._bytes, shard)
        self._store.flush()
        return ChunkRecord(summary, self._frames, self._skipped)


def _image_name(task: Task, layer: str) -> str:
    return f"{task.stem}_{layer}.png"


@dataclass(frozen=True)
class _Shard:
    """An open tar file of webdataset, which cuts names at a dot: members are named by index."""

    name: str
    file: AtomicFile
    tar: tarfile.TarFile

    @property
    def record(self) -> Record:
        """Name and checksum of the shard."""
        return {"name": self.name} | self.file.checksum

    def add(self, member: str, data: bytes) -> Record:
        """Append a member with fixed metadata; return its name, offset and checksum."""
        info = tarfile.TarInfo(member)
        info.size = len(data)
        info.mode = 0o644
        offset = self.file.size + tarfile.BLOCKSIZE
        self.tar.addfile(info, io.BytesIO(data))
        return {"name": self.name, "member": member, "offset": offset} | checksum(data)
