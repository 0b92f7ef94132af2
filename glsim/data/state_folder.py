"""The state of a run, kept in its data set's store: locks, plan.json and chunk records."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import parse_json, to_json
from glsim.core.files.store import Store
from glsim.data.chunks import Part
from glsim.data.disk_format import COMPLETE, HEADER, STATE
from glsim.data.record_schema import checksum_of, parse_frame, refuse_newer
from glsim.data.records import ChunkRecord, parse_chunk_record
from glsim.data.run_identity import refuse_difference

log = logging.getLogger(__name__)

PLAN = f"{STATE}/plan.json"
#: The numbers of parts and of chunks, from the first part until the merge.
_PARTS = f"{STATE}/parts"
_CHUNKS = f"{STATE}/chunks"
#: Most parts that a message names; chosen.
_NAMED = 20
#: Largest file in the state folder, bytes: a thousand times the record of 512 frames.
_MAX_BYTES = 1 << 30


class RunState:
    """The state folder ``.glsim`` of a data set.

        lock            held by the writing run; shared by parts, each with
                        part-<number>-of-<parts>.lock
        plan.json       settings, versions, renderer, fingerprint of the plan
        parts           numbers of parts and chunks, until they are merged
        chunks/         one compressed record per complete chunk
        complete.json   the header's checksum, once all records are merged into the manifest
        temporary/      incomplete files

    Many processes may read it; only the result of ``locked`` may write.
    """

    def __init__(self, store: Store) -> None:
        self.store = store

    @contextmanager
    def locked(
        self, identity: Mapping[str, Any], *, part: Part | None = None, wait: bool = False
    ) -> Iterator[RunState]:
        """Lock the data set or one part of it, and begin it or check that it can be continued.

        A part waits until another run ends, since this may be the merge of all parts.

        ``identity``: header entries that decide the bytes.

        Raises:
            DatasetError: another run holds the lock, the store holds other files, or writing fails.
            ConfigError: names the first different setting.
        """
        self._refuse_foreign_files()
        advice = "wait until it ends, or choose another folder"
        busy = DatasetError(f"{self.store}: another run is writing here: {advice}")
        temporary = f"{STATE}/temporary"
        with ExitStack() as stack:
            lock = partial(self.store.lock, f"{STATE}/lock", busy, shared=part is not None)
            try:
                stack.enter_context(lock())
            except DatasetError as error:
                if error is not busy or not (wait or part):
                    raise
                log.warning("%s: another run is writing here: waiting until it ends", self.store)
                stack.enter_context(lock(wait=True))
            if part is not None:
                other = f"part {part} is being made by another process: wait until it ends"
                name, part_busy = f"{STATE}/part-{part.name}.lock", f"{self.store}: {other}"
                stack.enter_context(self.store.lock(name, DatasetError(part_busy)))
                temporary += f"/{part.name}"
            state = RunState(stack.enter_context(self.store.writing(temporary)))
            # Object storage holds no lock: another run may be about to write its first frame.
            state._begin(identity, alone=part is None and type(self.store) is Store)
            yield state

    def _refuse_foreign_files(self) -> None:
        others = any(name != STATE for name in self.store.names(""))
        if others and all(self.store.size(name) is None for name in (PLAN, HEADER)):
            raise DatasetError(
                f"{self.store}: is not empty and holds no data set of glsim: choose a new folder"
            )

    def _begin(self, identity: Mapping[str, Any], alone: bool) -> None:
        where = self.store.where(PLAN)
        plan = to_json(identity, where).encode() + b"\n"
        if alone and self.store.names("") == [STATE] and not self.recorded_chunks():
            self.store.put(PLAN, plan)  # an earlier run failed before its first frame
            return
        begun = self.begun()
        if begun is None:  # the first of several parts writes the plan, others compare it
            begun = parse_json(self.store.put_first(PLAN, plan), where)
        try:
            refuse_difference(str(self.store), begun, identity)
        except ConfigError:
            if not alone or not self._discard_run_without_frames():
                raise
        if self.store.read(PLAN, _MAX_BYTES) != plan:
            self.store.put(PLAN, plan)

    def _discard_run_without_frames(self) -> bool:
        """Delete the records and shards of a run whose frames were all skipped; tell if it was."""
        numbers = self.recorded_chunks()
        try:
            records = [self.load_chunk(number) for number in numbers]
        except DatasetError:
            return False
        if not records or any(record.summary.frames for record in records):
            return False
        self.withdraw()
        self.discard_chunks(numbers)
        self.store.delete(file["name"] for record in records for file in _images_of(record))
        return True

    def begun(self) -> dict[str, Any] | None:
        """Read the identity from plan.json, or from the header if plan.json is gone or damaged.

        Raises DatasetError for a newer format, and for damage that leaves neither.
        """
        found, damage = list[dict[str, Any]](), list[DatasetError]()
        for name in (PLAN, HEADER):
            if (data := self.store.read(name, _MAX_BYTES)) is not None:
                try:
                    found.append(parse_json(data, self.store.where(name)))
                except DatasetError as error:
                    damage.append(error)
                else:
                    refuse_newer(found[-1], self.store.where(name))
        if damage and not found:
            raise damage[0]
        return found[0] if found else None

    def note_parts(self, parts: int, chunks: int) -> None:
        """Write the numbers of parts and of chunks, for ``missing_parts``."""
        self.store.put(_PARTS, b"%d parts, %d chunks\n" % (parts, chunks))

    def missing_parts(self) -> str:
        """Name the parts that lack chunks, as in "parts 3, 7 of 64"; "" without parts."""
        noted = self.store.read(_PARTS, _MAX_BYTES) or b""
        match = re.fullmatch(rb"([1-9]\d{0,5}) parts, (\d{1,7}) chunks\n", noted)
        parts, chunks = (int(match[1]), int(match[2])) if match else (1, 0)
        missing = sorted({n % parts or parts for n in {*range(chunks)} - self.recorded_chunks()})
        named = [f"{n} (or 0)" if n == parts else str(n) for n in missing[:_NAMED]]
        names = ", ".join([*named, *["..."][: len(missing) > _NAMED]])
        return f"part{'s'[: len(missing) - 1]} {names} of {parts}" if missing else ""

    def save_chunk(self, record: ChunkRecord) -> None:
        """Write a chunk's record; the chunk's images must be written and flushed before."""
        self.store.put(_chunk_file(record.summary.chunk), record.to_bytes())

    def recorded_chunks(self) -> set[int]:
        """Return the numbers of the chunks that have a record, intact or damaged."""
        stems = (name.partition(".")[0] for name in self.store.names(_CHUNKS))
        return {int(stem) for stem in stems if stem.isdigit()}

    def load_chunk(self, number: int) -> ChunkRecord:
        """Read a chunk's record. Raises DatasetError if it is absent or damaged."""
        data = self.store.read(_chunk_file(number), _MAX_BYTES)
        if data is None:
            raise DatasetError(f"{self.store}: the record of chunk {number} is gone")
        return parse_chunk_record(data)

    def discard_chunks(self, numbers: Iterable[int]) -> None:
        """Delete the records of chunks, so that the next run renders the chunks again."""
        self.store.delete(map(_chunk_file, numbers))

    @property
    def is_merged(self) -> bool:
        """Whether the data set is complete, its records merged into the manifest."""
        return self.store.size(COMPLETE) is not None

    def chunk_problem(self, record: ChunkRecord, number: int, frames: int) -> str | None:
        """Return the first problem of a chunk's record, by the plan and the stored files."""
        if record.summary.chunk != number or record.summary.total != frames:
            return f"the record of chunk {number} does not fit the plan"
        try:
            for file in _images_of(record):
                present = self.store.checksum(file["name"])
                if present is None:
                    return f"{file['name']} is missing"
                if present != checksum_of(file):
                    return f"{file['name']} is damaged"
        except DatasetError as error:
            return str(error)
        return None

    def withdraw(self) -> None:
        """Mark the data set as incomplete: delete its header, then the header's checksum."""
        self.store.delete([HEADER])
        self.store.delete([COMPLETE])

    def discard_part_files(self) -> None:
        """Delete the files of parts, such as their locks, while the whole data set is locked."""
        names = [f"{STATE}/{name}" for name in self.store.names(STATE)]
        self.store.delete(name for name in names if name.endswith(".lock") or name == _PARTS)


def _images_of(record: ChunkRecord) -> Iterator[Mapping[str, Any]]:
    """Yield the name, size and CRC32 of each file of a chunk: the shard, or all images."""
    if record.summary.shard is not None:
        yield record.summary.shard
        return
    where = f"the record of chunk {record.summary.chunk}"
    for line in record.frames:
        yield from parse_frame(line, where)["files"].values()


def _chunk_file(number: int) -> str:
    return f"{_CHUNKS}/{number:08d}.jsonl"
