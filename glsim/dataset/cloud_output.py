"""A data set in object storage while a run writes it: shards go up as they are complete.

The run works in a temporary folder of this machine. It copies the state of the bucket there (the
plan and the chunks' records, or the merged files), and from then on every change goes to both: a
shard is uploaded and removed here, then its record is uploaded; at the end the manifest, the cards,
and the header last of all.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from glsim.dataset.cloud_lock import cloud_lock
from glsim.dataset.disk_format import (
    CROISSANT,
    HEADER,
    MANIFEST,
    MERGED_INDEX,
    README,
    SKIPPED,
    STATE,
)
from glsim.dataset.identity import Inputs
from glsim.dataset.output_folder import INPUTS, OutputFolder
from glsim.dataset.parts import Part, named_part
from glsim.dataset.records import ChunkRecord
from glsim.errors import ConfigError, DatasetError
from glsim.files.atomic import file_checksum, wrap_read_errors, wrap_write_errors
from glsim.files.cloud import CloudFolder, cloud_url

#: Requests at the same time while the state is copied: each takes tens of milliseconds.
_CONNECTIONS = 16
_PLAN, _CHUNKS, _INDEX = f"{STATE}/plan.json", f"{STATE}/chunks", f"{STATE}/{MERGED_INDEX}"
#: What the objects are called that say that a part is left to other machines.
_LEFT = "left-"
#: Attempts to upload a shard whose bytes do not arrive as they were sent.
_UPLOADS = 3


def open_output(out: Path | str, part: Part | None = None) -> OutputFolder:
    """Return the folder ``out`` of a run, on disk or in object storage."""
    url = cloud_url(out)
    return OutputFolder(Path(out), part) if url is None else CloudOutput(url, part)


def upload_shard(cloud: CloudFolder, record: ChunkRecord, folder: Path) -> None:
    """Upload a chunk's shard, compare it with its record, and remove it here."""
    shard = record.summary.shard
    if shard is None:
        return
    name, expected = shard["name"], {"size": shard["size"], "crc32": shard["crc32"]}
    for _ in range(_UPLOADS):
        cloud.upload(name, folder / name)
        if cloud.checksum(name) == expected:
            break
    else:
        raise DatasetError(f"{cloud.where(name)}: did not arrive as it was sent: run it again")
    with wrap_write_errors(folder / name):
        (folder / name).unlink()


class ScratchFolder(OutputFolder):
    """A folder for one chunk that a node of a cluster makes; it ends with the task.

    cloud: where shards go. Otherwise ``files`` are what the driver writes.
    """

    def __init__(self, out: Path, cloud: CloudFolder | None = None) -> None:
        super().__init__(out)
        self._cloud = cloud
        self.record: ChunkRecord | None = None
        with wrap_write_errors(out):
            self._temporary.mkdir(parents=True)

    def flush_images(self, record: ChunkRecord) -> None:
        """Upload the shard, if there is a place for it; nothing stays here."""
        if self._cloud is not None:
            upload_shard(self._cloud, record, self.out)

    def save_chunk(self, record: ChunkRecord) -> None:
        """Keep the record in memory."""
        self.record = record

    def files(self) -> dict[str, bytes]:
        """Return name -> bytes of the files that were written and not uploaded."""
        shutil.rmtree(self._temporary.parent)
        with wrap_read_errors(self.out):
            paths = [path for path in self.out.rglob("*") if path.is_file()]
            return {path.relative_to(self.out).as_posix(): path.read_bytes() for path in paths}


class CloudOutput(OutputFolder):
    """The output folder of a run in object storage; ``out`` is its temporary folder here."""

    def __init__(self, url: str, part: Part | None = None) -> None:
        super().__init__(Path(tempfile.mkdtemp(prefix="glsim-")), part)
        self.cloud = CloudFolder(url)
        self._checksums: dict[str, dict[str, int] | None] = {}
        self._whole = part is None

    @contextmanager
    def locked(
        self, identity: Mapping[str, Any], inputs: Inputs | None = None, *, wait: bool = False
    ) -> Iterator[None]:
        """Lock the folder of the bucket, and copy its state; otherwise as in OutputFolder."""
        with self._session("lock", wait=wait), super().locked(identity, inputs):
            yield

    @contextmanager
    def locked_part(
        self, identity: Mapping[str, Any], inputs: Inputs | None = None
    ) -> Iterator[None]:
        """Lock one part in the bucket, and copy its state; otherwise as in OutputFolder."""
        assert self._part is not None
        with (
            self._session(f"part-{self._part.name}.lock", wait=False),
            super().locked_part(identity, inputs),
        ):
            yield

    @contextmanager
    def _session(self, lock: str, *, wait: bool) -> Iterator[None]:
        with ExitStack() as stack:
            stack.callback(shutil.rmtree, self.out, ignore_errors=True)
            self._refuse_foreign_prefix()
            stack.enter_context(cloud_lock(self.cloud, f"{STATE}/{lock}", wait=wait))
            self._pull()
            yield

    def _refuse_foreign_prefix(self) -> None:
        others = [name for name in self.cloud.names("") if name not in (STATE, "")]
        if others and not any(map(self.cloud.size, (_PLAN, HEADER))):
            raise DatasetError(
                f"{self.cloud}: is not empty and holds no data set of glsim: choose another prefix"
            )

    # ---------------------------------------------------------------- copying the state

    def _pull(self) -> None:
        """Copy what the bucket has: the plan, and the merged files or the chunks' records."""
        merged = [_INDEX, HEADER, MANIFEST, SKIPPED, README, CROISSANT]
        wanted = [_PLAN, f"{STATE}/{INPUTS}"]
        if self.cloud.size(_INDEX) is not None:
            wanted += merged
        elif self._whole:
            wanted += [f"{_CHUNKS}/{name}" for name in self.cloud.names(_CHUNKS)]
        else:
            wanted += [f"{_CHUNKS}/{name}" for name in self.cloud.names(_CHUNKS) if self._own(name)]
        with ThreadPoolExecutor(_CONNECTIONS) as pool:
            list(pool.map(self._copy, wanted))
            shards = [name for name in self.cloud.names("") if name.endswith(".tar")]
            self._checksums = dict(zip(shards, pool.map(self.cloud.checksum, shards), strict=True))

    def _own(self, name: str) -> bool:
        """Return whether a chunk's record is of this part."""
        number = name.partition(".")[0]
        return self._part is not None and (
            number.isdigit() and int(number) % self._part.of == self._part.number % self._part.of
        )

    def _copy(self, name: str) -> None:
        """Copy an object, if there is one."""
        self.cloud.download(name, self.out / name)

    # ---------------------------------------------------------------- every change goes to both

    def _begin(self, identity: Mapping[str, Any], inputs: Inputs | None) -> None:
        before = {name: file_checksum(self.out / name) for name in (_PLAN, f"{STATE}/{INPUTS}")}
        try:
            super()._begin(identity, inputs)
        except ConfigError as error:  # it names the temporary folder
            raise ConfigError(str(error).replace(str(self.out), self.cloud.url)) from None
        for name, checksum in before.items():
            if (found := file_checksum(self.out / name)) is not None and found != checksum:
                self.cloud.upload(name, self.out / name)

    def flush_images(self, record: ChunkRecord) -> None:
        """Upload the shard of a chunk."""
        upload_shard(self.cloud, record, self.out)

    def save_chunk(self, record: ChunkRecord) -> None:
        """Record that a chunk is complete, here and in the bucket; its shard must be there."""
        super().save_chunk(record)
        name = self._chunk_file(record.summary.chunk).name
        self.cloud.put(f"{_CHUNKS}/{name}", record.to_bytes())

    def begun_identity(self) -> dict[str, Any]:
        """Return the identity of the data set. Raises DatasetError if none was begun there."""
        self._copy(_PLAN)
        self._copy(HEADER)
        try:
            return super().begun_identity()
        except DatasetError as error:
            raise DatasetError(str(error).replace(str(self.out), self.cloud.url)) from None

    @property
    def is_merged(self) -> bool:
        """Whether a run has completed the data set."""
        if self.out.exists():  # the run goes on: nobody else changes the state
            return super().is_merged
        return self.cloud.size(_INDEX) is not None

    def recorded_chunks(self) -> set[int]:
        """Return the numbers of the chunks that have a record; after the run, of all parts."""
        if self.out.exists():
            return super().recorded_chunks()
        stems = [name.partition(".")[0] for name in self.cloud.names(_CHUNKS)]
        return {int(stem) for stem in stems if stem.isdigit()}

    def discard_chunks(self, numbers: Iterable[int]) -> None:
        """Remove the records of chunks, so that the next run renders them again."""
        gone = list(numbers)
        super().discard_chunks(gone)
        self.cloud.delete(f"{_CHUNKS}/{self._chunk_file(number).name}" for number in gone)

    def publish_merged(self, names: Iterable[str]) -> None:
        """Upload all that describes the whole data set, its header and the index last."""
        for name in [*sorted(names), HEADER, _INDEX]:
            self.cloud.upload(name, self.out / name)

    def withdraw(self) -> None:
        """Remove what calls the data set complete."""
        self.cloud.delete([HEADER, _INDEX])
        super().withdraw()

    def discard_chunk_records(self) -> None:
        """Remove the chunk records, which the manifest replaces; also those that no list shows."""
        names = {self._chunk_file(number).name for number in super().recorded_chunks()}
        super().discard_chunk_records()
        self.cloud.delete(f"{_CHUNKS}/{name}" for name in names | set(self.cloud.names(_CHUNKS)))

    def leave_part(self, part: Part) -> None:
        """Record in the bucket that a part's chunks are left to other machines."""
        self.cloud.put(f"{STATE}/{_LEFT}{part.name}", b"")

    def left_parts(self) -> list[Part]:
        """Return the parts that are left to other machines, in order."""
        names = [name for name in self.cloud.names(STATE) if name.startswith(_LEFT)]
        parts = [named_part(name.removeprefix(_LEFT)) for name in names]
        return sorted(parts, key=lambda part: part.name)

    def take_part(self, part: Part) -> None:
        """Record that the chunks of a part that was left are complete."""
        self.cloud.delete([f"{STATE}/{_LEFT}{part.name}"])

    def discard_part_files(self) -> None:
        """Remove the locks of parts, and what says that some were left."""
        super().discard_part_files()
        names = self.cloud.names(STATE)
        old = [name for name in names if name.endswith(".lock") or name.startswith(_LEFT)]
        self.cloud.delete(f"{STATE}/{name}" for name in old)

    def _file_problem(self, file: Mapping[str, Any]) -> str | None:
        """Compare a shard in the bucket with its record."""
        name = file["name"]
        found = self._checksums.get(name) or self.cloud.checksum(name)
        if found is None:
            return f"{name} is missing"
        same = found == {"size": file["size"], "crc32": file["crc32"]}
        return None if same else f"{name} is damaged"
