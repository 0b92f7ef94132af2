"""The state of a run in the store of its data set: locks, plan, chunk records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any

from glsim.dataset.disk_format import HEADER, MERGED_INDEX, STATE
from glsim.dataset.header import header_problem
from glsim.dataset.identity import InputHashes, refuse_changed_inputs, refuse_difference
from glsim.dataset.parts import Part, named_part
from glsim.dataset.record_schema import parse_frame
from glsim.dataset.records import ChunkRecord, parse_chunk_record
from glsim.errors import DatasetError
from glsim.files.atomic import checksum, parse_json, to_json
from glsim.files.store import Store

#: The records' first lines, once all records are merged into the manifest.
INDEX = f"{STATE}/{MERGED_INDEX}"
_PLAN, _INPUTS, _CHUNKS = f"{STATE}/plan.json", f"{STATE}/inputs.json", f"{STATE}/chunks"
_LEFT = "left-"
_SEAL = "crc32"
#: Largest file of the state, bytes: a record of 512 frames takes a thousandth.
_MAX_BYTES = 1 << 30


def _sealed(identity: Mapping[str, Any], where: str) -> bytes:
    """Return an identity as the bytes of a plan, which end with the CRC32 of the rest."""
    crc32 = checksum(to_json(identity, where).encode())["crc32"]
    return to_json({**identity, _SEAL: crc32}, where).encode() + b"\n"


def _unsealed(plan: bytes, where: str) -> dict[str, Any]:
    """Return the identity in a plan. Raises DatasetError for one that was changed.

    Plans of glsim 0.2 and before have no checksum.
    """
    identity = parse_json(plan, where)
    crc32 = identity.pop(_SEAL, None)
    if crc32 not in (None, checksum(to_json(identity, where).encode())["crc32"]):
        raise DatasetError(f"{where}: is damaged: its CRC32 differs: restore it from a copy")
    return identity


class PartBusyError(DatasetError):
    """Another process makes this part."""


class RunState:
    """The folder ``.glsim`` of a data set.

        lock            held by the run that writes here. Parts hold it together, each with
                        part-<number>-of-<parts>.lock
        left-<part>     a part whose machine computes differently, and left its chunks to others
        plan.json       what is being made: settings, versions, renderer, fingerprint of the plan
        inputs.json     hashes of the files that the sources read; it only serves messages
        chunks/         one record per complete chunk
        chunks.jsonl    the records' first lines, once all records are merged into the manifest
        temporary/      files being written

    Many processes may read it; what ``locked`` returns may write.
    """

    def __init__(self, store: Store) -> None:
        self.store = store

    @contextmanager
    def locked(
        self,
        identity: Mapping[str, Any],
        inputs: InputHashes | None = None,
        *,
        part: Part | None = None,
        wait: bool = False,
    ) -> Iterator[RunState]:
        """Lock the data set, or one part of it, and begin or continue it.

        Args:
            identity: what decides its bytes.
            inputs: the hashes that are part of the identity, by file, for messages about a change.
            part: lock this part, while others make theirs.
            wait: wait until other runs end.

        Raises:
            DatasetError: another run holds the lock, the place holds other files, or it cannot be
                written; PartBusyError if another process makes the part.
            ConfigError: names the first setting that differs.
        """
        self._refuse_foreign_files()
        busy = DatasetError(
            f"{self.store}: another run is writing here: wait until it ends, or choose another "
            "folder"
        )
        temporary = f"{STATE}/temporary"
        with ExitStack() as stack:
            lock = self.store.lock(f"{STATE}/lock", busy, wait=wait, shared=part is not None)
            stack.enter_context(lock)
            if part is not None:
                part_busy = PartBusyError(
                    f"{self.store}: part {part} is being made by another process: wait until it "
                    "ends"
                )
                name = f"{STATE}/part-{part.name}.lock"
                stack.enter_context(self.store.lock(name, part_busy))
                temporary += f"/{part.name}"
            state = RunState(stack.enter_context(self.store.writing(temporary)))
            state._begin(identity, inputs)
            yield state

    def begun_identity(self) -> dict[str, Any]:
        """Return the identity of the data set. Raises DatasetError if none was begun here."""
        begun = self._begun()
        if begun is None:
            raise DatasetError(f"{self.store}: no data set was begun here")
        return begun

    def _refuse_foreign_files(self) -> None:
        others = any(name != STATE for name in self.store.names(""))
        if others and all(self.store.size(name) is None for name in (_PLAN, HEADER)):
            raise DatasetError(
                f"{self.store}: is not empty and holds no data set of glsim: choose a new folder"
            )

    def _begun(self) -> dict[str, Any] | None:
        """Return the identity in the plan; in the header, if the plan is gone or damaged.

        Raises DatasetError for a damaged plan of a data set that has no sound header.
        """
        plan, damage = self.store.read(_PLAN, _MAX_BYTES), None
        if plan is not None:
            try:
                return _unsealed(plan, self.store.where(_PLAN))
            except DatasetError as error:
                damage = error
        header = self.store.read(HEADER, _MAX_BYTES)
        if header is None or header_problem(self.store, checksum(header)) is not None:
            if damage is not None:
                raise damage
            return None if header is None else parse_json(header, self.store.where(HEADER))
        return parse_json(header, self.store.where(HEADER))

    def plan_problem(self) -> str | None:
        """Return how the plan is damaged; None if it is sound, or gone (a run writes it again)."""
        try:
            plan = self.store.read(_PLAN, _MAX_BYTES)
            if plan is not None:
                _unsealed(plan, _PLAN)
        except DatasetError as error:
            return str(error)
        return None

    def _begin(self, identity: Mapping[str, Any], inputs: InputHashes | None) -> None:
        plan = _sealed(identity, self.store.where(_PLAN))
        begun = self._begun()
        if begun is None:  # one of several parts is the first, and the others compare theirs
            begun = _unsealed(self.store.put_first(_PLAN, plan), self.store.where(_PLAN))
        self._refuse_difference(begun, identity, inputs)
        self._put_changed(_PLAN, plan)
        if inputs is not None and inputs.sources:
            self._put_changed(_INPUTS, to_json(inputs.sources, _INPUTS).encode() + b"\n")

    def _refuse_difference(
        self, begun: Mapping[str, Any], identity: Mapping[str, Any], inputs: InputHashes | None
    ) -> None:
        if inputs is not None:
            refuse_changed_inputs(str(self.store), begun, inputs, self._begun_inputs())
        refuse_difference(str(self.store), begun, identity)

    def is_merged_as(self, identity: Mapping[str, Any], inputs: InputHashes | None = None) -> bool:
        """Return whether a run has completed the data set with this identity; nothing is written.

        Raises ConfigError for another identity.
        """
        if not self.is_merged or self.plan_problem() is not None:
            return False
        self._refuse_difference(self.begun_identity(), identity, inputs)
        return True

    def _put_changed(self, name: str, data: bytes) -> None:
        if self.store.read(name, _MAX_BYTES) != data:
            self.store.put(name, data)

    def _begun_inputs(self) -> dict[str, Any]:
        """Return source -> file -> hash of the begun data set; {} if that is not known."""
        try:
            return parse_json(self.store.read(_INPUTS, _MAX_BYTES) or b"", _INPUTS)
        except DatasetError:
            return {}

    # ---------------------------------------------------------------- chunk records

    def save_chunk(self, record: ChunkRecord) -> None:
        """Record that a chunk is complete; its images must be in place, and flushed."""
        self.store.put(_chunk_file(record.summary.chunk), record.to_bytes())

    def recorded_chunks(self) -> set[int]:
        """Return the numbers of the chunks that have a record, good or damaged."""
        stems = (name.partition(".")[0] for name in self.store.names(_CHUNKS))
        return {int(stem) for stem in stems if stem.isdigit()}

    def load_chunk(self, number: int) -> ChunkRecord:
        """Read a chunk's record. Raises DatasetError if there is none, or it is damaged."""
        data = self.store.read(_chunk_file(number), _MAX_BYTES)
        if data is None:
            raise DatasetError(f"{self.store}: the record of chunk {number} is gone")
        return parse_chunk_record(data)

    def discard_chunks(self, numbers: Iterable[int]) -> None:
        """Remove the records of chunks, so that the next run renders them again."""
        self.store.delete(map(_chunk_file, numbers))

    @property
    def is_merged(self) -> bool:
        """Whether a run has completed the data set."""
        return self.store.size(INDEX) is not None

    def chunk_problem(self, record: ChunkRecord, number: int, frames: int) -> str | None:
        """Compare a record with the plan and with the files in the store.

        Args:
            record: of the chunk.
            number: of the chunk in the plan.
            frames: number of its frames in the plan.

        Returns:
            The first problem; None if nothing is wrong.
        """
        if record.summary.chunk != number or record.summary.total != frames:
            return f"the record of chunk {number} does not fit the plan"
        try:
            problems = map(self._file_problem, _images_of(record))
            return next((problem for problem in problems if problem is not None), None)
        except DatasetError as error:
            return str(error)

    def _file_problem(self, file: Mapping[str, Any]) -> str | None:
        found = self.store.checksum(file["name"])
        if found is None:
            return f"{file['name']} is missing"
        same = found["size"] == file["size"] and found["crc32"] == file["crc32"]
        return None if same else f"{file['name']} is damaged"

    def withdraw(self) -> None:
        """Mark the data set as incomplete: remove its header, then the index of its chunks."""
        self.store.delete([HEADER])
        self.store.delete([INDEX])

    # ---------------------------------------------------------------- parts

    def leave_part(self, part: Part) -> None:
        """Let other parts take the chunks of this one."""
        self.store.put(f"{STATE}/{_LEFT}{part.name}", b"")

    def left_parts(self) -> list[Part]:
        """Return the parts whose chunks others may take, in the order of their names."""
        names = (name for name in self.store.names(STATE) if name.startswith(_LEFT))
        return [named_part(name.removeprefix(_LEFT)) for name in names]

    def take_part(self, part: Part) -> None:
        """Record that the chunks of a part that was left are complete."""
        self.store.delete([f"{STATE}/{_LEFT}{part.name}"])

    def discard_part_files(self) -> None:
        """Remove the locks and marks of parts; none is in use while the whole set is locked."""
        names = self.store.names(STATE)
        old = [name for name in names if name.endswith(".lock") or name.startswith(_LEFT)]
        self.store.delete(f"{STATE}/{name}" for name in old)


def _images_of(record: ChunkRecord) -> Iterator[Mapping[str, Any]]:
    """Yield the name, size and CRC32 of the files of a chunk: a shard, or each image.

    Raises DatasetError if a line of the record is damaged.
    """
    if record.summary.shard is not None:
        yield record.summary.shard
        return
    where = f"the record of chunk {record.summary.chunk}"
    for line in record.frames:
        yield from parse_frame(line, where)["files"].values()


def _chunk_file(number: int) -> str:
    return f"{_CHUNKS}/{number:08d}.jsonl"
