"""The folder of a data set while it is being made: its lock, its plan, its chunk records."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from glsim.dataset.files import cannot_write, check_of, read_json, to_json, write_file, writing
from glsim.dataset.layout import HEADER, STATE, Chunk
from glsim.dataset.record import ChunkRecord, parse_chunk
from glsim.errors import ConfigError, DatasetError

#: Settings that do not change what a frame looks like, so that a run may be resumed with others.
_FREE_SETTINGS = ("settings.strict",)


class Store:
    """The folder ``out`` and what glsim keeps in its sub-folder ``.glsim``.

        lock            held by the run that writes here; the kernel frees it when a process dies
        plan.json       what is being made: settings, versions, renderer, fingerprint of the plan
        chunks/         one record a complete chunk
        chunks.jsonl    in their place once all are merged into the manifest: their first lines
        temporary/      files being written

    ``save``, ``load`` and ``temporary`` may be used by many processes, the rest by the one that
    has opened it.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self._state = out / STATE
        self._chunks = self._state / "chunks"
        self._temporary = self._state / "temporary"
        self.merged_index = self._state / "chunks.jsonl"

    @contextmanager
    def opened(self, identity: Mapping[str, Any]) -> Iterator[None]:
        """Lock the folder, and make sure that it holds, or will hold, what ``identity`` says.

        Raises DatasetError if another run holds it, if it is not empty and no data set of glsim,
        or if it cannot be written; ConfigError naming the first setting that differs.
        """
        self._refuse_other_folders()
        with writing(self.out):
            self._state.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self._state / "lock", timeout=0)
        try:
            lock.acquire()
        except Timeout:
            raise DatasetError(
                f"{self.out}: another run is writing here: wait until it ends, or choose another "
                "folder"
            ) from None
        except OSError as error:
            raise cannot_write(self._state / "lock", error) from error
        try:
            self._begin(identity)
            yield
        finally:
            shutil.rmtree(self._temporary, ignore_errors=True)
            lock.release()

    def _refuse_other_folders(self) -> None:
        if not self.out.exists():
            return
        if not self.out.is_dir():
            raise DatasetError(f"{self.out}: is a file: choose a folder")
        with writing(self.out):
            others = any(path.name != STATE for path in self.out.iterdir())
        if others and self._begun() is None:
            raise DatasetError(
                f"{self.out}: is not empty and holds no data set of glsim: choose a new folder"
            )

    def _begun(self) -> Path | None:
        """The file that says what the folder holds."""
        files = (self._state / "plan.json", self.out / HEADER)
        return next((file for file in files if file.exists()), None)

    def _begin(self, identity: Mapping[str, Any]) -> None:
        begun = self._begun()
        if begun is not None:
            _refuse_difference(self.out, read_json(begun), identity)
        with writing(self._temporary):
            shutil.rmtree(self._temporary, ignore_errors=True)
            self._temporary.mkdir()
            self._chunks.mkdir(exist_ok=True)
        plan = self._state / "plan.json"
        data = to_json(identity, str(plan)).encode() + b"\n"
        if begun != plan or plan.read_bytes() != data:
            write_file(plan, data, self.temporary(), sync=True)

    def temporary(self, name: str = "file") -> Path:
        """Where this process may write one file at a time before it is renamed into place."""
        return self._temporary / f"{os.getpid()}-{name}"

    # ---------------------------------------------------------------- chunk records

    def _chunk_file(self, number: int) -> Path:
        return self._chunks / f"{number:08d}.jsonl"

    def save(self, record: ChunkRecord) -> None:
        """Say that a chunk is complete; its images must be in place."""
        write_file(self._chunk_file(record.summary.chunk), record.dump(), self.temporary())

    def load(self, number: int) -> ChunkRecord | None:
        """A chunk's record; None if there is none. DatasetError if it is damaged."""
        try:
            data = self._chunk_file(number).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DatasetError(f"{self._chunk_file(number)}: {error.strerror}") from error
        return parse_chunk(data)

    @property
    def is_merged(self) -> bool:
        """Whether the run was complete once."""
        return self.merged_index.exists()

    def chunk_problem(self, record: ChunkRecord, chunk: Chunk) -> str | None:
        """Compare what a record says with the plan and with the files; None if all is well."""
        if record.summary.chunk != chunk.number or record.summary.total != len(chunk.tasks):
            return f"the record of chunk {chunk.number} does not fit the plan"
        if record.summary.shard is not None:
            return self._file_problem(record.summary.shard)
        for line in record.frames:
            for file in json.loads(line)["files"].values():
                problem = self._file_problem(file)
                if problem is not None:
                    return problem
        return None

    def _file_problem(self, file: Mapping[str, Any]) -> str | None:
        found = check_of(self.out / file["name"])
        if found is None:
            return f"{file['name']} is missing"
        same = found["size"] == file["size"] and found["crc32"] == file["crc32"]
        return None if same else f"{file['name']} is damaged"

    def discard_chunks(self) -> None:
        """Remove the records, which the manifest replaces."""
        with writing(self._chunks):
            shutil.rmtree(self._chunks)


def _refuse_difference(out: Path, begun: Mapping[str, Any], identity: Mapping[str, Any]) -> None:
    """ConfigError for the first entry of ``identity`` that is not as the folder was begun with."""
    old, new = _flat(begun), _flat(json.loads(to_json(identity, str(out))))
    for name in [*new, *old]:
        ours = name.split(".")[0] in identity and name not in _FREE_SETTINGS
        if not ours or old.get(name) == new.get(name):
            continue
        if name == "plan":
            raise ConfigError(
                f"{out} was begun with other faces: the files of a source have changed: restore "
                "them, or choose another folder"
            )
        raise ConfigError(
            f"{out} was begun with {name.removeprefix('settings.')} = "
            f"{json.dumps(old.get(name))}, not {json.dumps(new.get(name))}: continue with the "
            "same, or choose another folder"
        )


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
            value = dict(enumerate(value))
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
