"""The output folder while a run writes it: its lock, its plan, its chunk records."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from glsim.dataset.disk_format import HEADER, MERGED_INDEX, STATE
from glsim.dataset.identity import Inputs, refuse_changed_inputs, refuse_difference
from glsim.dataset.parts import Part, named_part
from glsim.dataset.records import ChunkRecord, parse_chunk_record
from glsim.dataset.schema import parse_frame
from glsim.errors import DatasetError
from glsim.files.atomic import (
    cannot_write,
    file_checksum,
    read_json,
    to_json,
    wrap_write_errors,
    write_atomic,
)
from glsim.files.flush import flush_file, flush_files
from glsim.files.lock import locked, locked_together

#: The file with the hashes of the sources' files; it only serves messages.
INPUTS = "inputs.json"


class PartBusyError(DatasetError):
    """Another process makes this part."""


class OutputFolder:
    """The folder ``out`` of a data set, with the run's files in its sub-folder ``.glsim``.

        lock            held by the run that writes here; the kernel frees it when a process dies.
                        Parts hold it together, each with part-<number>-of-<parts>.lock
        left-<part>     a part whose machine computes differently, and left its chunks to others
        plan.json       what is being made: settings, versions, renderer, fingerprint of the plan
        inputs.json     hashes of the files that the sources read
        chunks/         one record per complete chunk
        chunks.jsonl    the records' first lines, once all records are merged into the manifest
        temporary/      files being written

    Many processes may use ``save_chunk``, ``load_chunk`` and ``temporary_path``; only the process
    that holds the lock may use the rest.
    """

    def __init__(self, out: Path, part: Part | None = None) -> None:
        self.out = out
        self._part = part
        self._state = out / STATE
        self._chunks = self._state / "chunks"
        self._temporary = self._state / "temporary"
        if part is not None:
            self._temporary /= part.name
        self.merged_index = self._state / MERGED_INDEX

    @contextmanager
    def locked(
        self, identity: Mapping[str, Any], inputs: Inputs | None = None, *, wait: bool = False
    ) -> Iterator[None]:
        """Lock the folder, and begin or continue the data set that ``identity`` describes.

        inputs: the hashes that are part of the identity, by file, for messages about a change.
        wait: until other runs end. Raises DatasetError if another run holds the lock, if the folder
        is not empty and holds no data set of glsim, or if it cannot be written; ConfigError names
        the first setting that differs.
        """
        self._make_state()
        with locked(self._state / "lock", self._busy(), wait=wait):
            try:
                self._begin(identity, inputs)
                yield
            finally:
                shutil.rmtree(self._temporary, ignore_errors=True)

    @contextmanager
    def locked_part(
        self, identity: Mapping[str, Any], inputs: Inputs | None = None
    ) -> Iterator[None]:
        """Lock one part, while others make theirs, and begin or continue the data set.

        Raises as ``locked``, and DatasetError if another process makes this part.
        """
        assert self._part is not None
        self._make_state()
        busy = PartBusyError(
            f"{self.out}: part {self._part} is being made by another process: wait until it ends"
        )
        with (
            locked_together(self._state / "lock", self._busy()),
            locked(self._state / f"part-{self._part.name}.lock", busy),
        ):
            try:
                # One part at a time begins: the first writes the identity, the others compare it.
                with locked(self._state / "begin.lock", busy, wait=True):
                    self._begin(identity, inputs)
                yield
            finally:
                shutil.rmtree(self._temporary, ignore_errors=True)

    def _make_state(self) -> None:
        self._refuse_foreign_folder()
        with wrap_write_errors(self.out):
            self._state.mkdir(parents=True, exist_ok=True)

    def _busy(self) -> DatasetError:
        return DatasetError(
            f"{self.out}: another run is writing here: wait until it ends, or choose another folder"
        )

    def begun_identity(self) -> dict[str, Any]:
        """Return the identity of the data set. Raises DatasetError if none was begun here."""
        file = self._identity_file()
        if file is None:
            raise DatasetError(f"{self.out}: no data set was begun here")
        return read_json(file)

    def _refuse_foreign_folder(self) -> None:
        if not self.out.exists():
            return
        if not self.out.is_dir():
            raise DatasetError(f"{self.out}: is a file: choose a folder")
        with wrap_write_errors(self.out):
            others = any(path.name != STATE for path in self.out.iterdir())
        if others and self._identity_file() is None:
            raise DatasetError(
                f"{self.out}: is not empty and holds no data set of glsim: choose a new folder"
            )

    def _identity_file(self) -> Path | None:
        """Return the file with the identity of the data set; None in a new folder."""
        files = (self._state / "plan.json", self.out / HEADER)
        return next((file for file in files if file.exists()), None)

    def _begin(self, identity: Mapping[str, Any], inputs: Inputs | None) -> None:
        identity_file = self._identity_file()
        if identity_file is not None:
            begun = read_json(identity_file)
            if inputs is not None:
                refuse_changed_inputs(self.out, begun, inputs, self._begun_files())
            refuse_difference(self.out, begun, identity)
        with wrap_write_errors(self._temporary):
            shutil.rmtree(self._temporary, ignore_errors=True)
            self._temporary.mkdir(parents=True)
            self._chunks.mkdir(exist_ok=True)
        plan = self._state / "plan.json"
        data = to_json(identity, str(plan)).encode() + b"\n"
        if identity_file != plan or plan.read_bytes() != data:
            write_atomic(data, plan, temporary=self.temporary_path())

        if inputs is not None and inputs.sources:
            data = to_json(inputs.sources, INPUTS).encode() + b"\n"
            write_atomic(data, self._state / INPUTS, temporary=self.temporary_path())

    def _begun_files(self) -> dict[str, Any]:
        """Return source -> file -> hash of the begun data set; {} if that is not known."""
        try:
            return read_json(self._state / INPUTS)
        except DatasetError:
            return {}

    def temporary_path(self, name: str = "file") -> Path:
        """Return a new path for a file being written."""
        return self._temporary / f"{secrets.token_hex(8)}-{name}"

    # ---------------------------------------------------------------- chunk records

    def _chunk_file(self, number: int) -> Path:
        return self._chunks / f"{number:08d}.jsonl"

    def flush_images(self, record: ChunkRecord) -> None:
        """Flush the images and folders of a chunk to the disk."""
        shard = record.summary.shard
        names = [] if shard is None else [shard["name"]]
        if shard is None:
            files = (json.loads(line)["files"].values() for line in record.frames)
            names = [file["name"] for images in files for file in images]
        with wrap_write_errors(self.out):
            flush_files([self.out / name for name in names], self.out)

    def save_chunk(self, record: ChunkRecord) -> None:
        """Record that a chunk is complete; its images must be in place, and flushed."""
        path = self._chunk_file(record.summary.chunk)
        write_atomic(record.to_bytes(), path, temporary=self.temporary_path())

    def recorded_chunks(self) -> set[int]:
        """Return the numbers of the chunks that have a record, good or damaged."""
        try:
            with os.scandir(self._chunks) as entries:
                stems = [entry.name.partition(".")[0] for entry in entries]
        except FileNotFoundError:
            return set()  # merged
        except OSError as error:
            raise cannot_write(self._chunks, error) from error
        return {int(stem) for stem in stems if stem.isdigit()}

    def load_chunk(self, number: int) -> ChunkRecord | None:
        """Read a chunk's record; None if there is none. Raises DatasetError if it is damaged."""
        try:
            data = self._chunk_file(number).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DatasetError(f"{self._chunk_file(number)}: {error.strerror}") from error
        return parse_chunk_record(data)

    def discard_chunks(self, numbers: Iterable[int]) -> None:
        """Remove the records of chunks, so that the next run renders them again."""
        with wrap_write_errors(self._chunks):
            for number in numbers:
                self._chunk_file(number).unlink(missing_ok=True)

    @property
    def is_merged(self) -> bool:
        """Whether a run has completed the data set."""
        return self.merged_index.exists()

    def chunk_problem(self, record: ChunkRecord, number: int, frames: int) -> str | None:
        """Compare a record with the plan and with the files on disk; None if nothing is wrong.

        frames: number of frames of this chunk in the plan.
        """
        if record.summary.chunk != number or record.summary.total != frames:
            return f"the record of chunk {number} does not fit the plan"
        if record.summary.shard is not None:
            return self._file_problem(record.summary.shard)
        for line in record.frames:
            try:
                files = parse_frame(line, f"the record of chunk {number}")["files"]
            except DatasetError as error:
                return str(error)
            for file in files.values():
                problem = self._file_problem(file)
                if problem is not None:
                    return problem
        return None

    def _file_problem(self, file: Mapping[str, Any]) -> str | None:
        actual = file_checksum(self.out / file["name"])
        if actual is None:
            return f"{file['name']} is missing"
        same = actual["size"] == file["size"] and actual["crc32"] == file["crc32"]
        return None if same else f"{file['name']} is damaged"

    def publish_merged(self, names: Iterable[str]) -> None:
        """Do nothing: the files of the merged data set are in their place.

        names: of all that describe the whole set, besides its header and the index of chunks.
        """

    def withdraw(self) -> None:
        """Remove what calls the data set complete, the header before the index of chunks."""
        with wrap_write_errors(self.out):
            (self.out / HEADER).unlink(missing_ok=True)
            flush_file(self.out)
            self.merged_index.unlink()

    def discard_chunk_records(self) -> None:
        """Remove the chunk records, which the manifest replaces."""
        with wrap_write_errors(self._chunks):
            shutil.rmtree(self._chunks)

    # ---------------------------------------------------------------- parts

    def leave_part(self, part: Part) -> None:
        """Let other parts take the chunks of this one."""
        with wrap_write_errors(self._state):
            (self._state / f"left-{part.name}").touch()

    def left_parts(self) -> list[Part]:
        """Return the parts whose chunks others may take, in the order of their names."""
        with wrap_write_errors(self._state):
            return sorted(
                (named_part(path.name.removeprefix("left-")) for path in self._left_files()),
                key=lambda part: part.name,
            )

    def take_part(self, part: Part) -> None:
        """Record that the chunks of a part that was left are complete."""
        with wrap_write_errors(self._state):
            (self._state / f"left-{part.name}").unlink(missing_ok=True)

    def discard_part_files(self) -> None:
        """Remove the locks and marks of parts; nobody uses one while the folder is locked."""
        with wrap_write_errors(self._state):
            for file in [*self._state.glob("*.lock"), *self._left_files()]:
                file.unlink(missing_ok=True)

    def _left_files(self) -> list[Path]:
        return list(self._state.glob("left-*-of-*"))
