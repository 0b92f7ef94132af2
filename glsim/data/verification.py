"""Verification of a complete data set: its files against its header and manifest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

from glsim.core.errors import DatasetError, counted
from glsim.core.files.cloud import open_store
from glsim.core.files.store import Store
from glsim.data.disk_format import HEADER, MANIFEST, METADATA, SKIPPED
from glsim.data.header import Manifest, open_header
from glsim.data.record_schema import checksum_of
from glsim.data.stored_frame import StoredImages
from glsim.settings.schema import SPLIT_NAMES

_Record = Mapping[str, Any]
_PERSON = itemgetter("split", "subject")
STRAY = "is in no record: delete it, or move it out"
LOST = "is in no record, since a list is damaged: keep it, and repair the list (--repair)"


def verify(path: Path | str, deep: bool = False, *, strays: bool = True) -> list[str]:
    """Return the problems of a data set, one line each; [] if there are none.

    Checks the schema and checksums of header and manifest, the counts, that no subject is in two
    splits (by records and by folders), that every file is a regular file inside the data set with
    its recorded size, that no two frames of a subject share an image, and that every file in a
    split has a record. Never raises DatasetError.

    Args:
        deep: also check the CRC32 of every shard, and decode every image.
        strays: also list files in the splits without a record.
    """
    store = open_store(path)
    try:
        header, problem, manifest = open_header(store)
    except DatasetError as error:
        return [str(error)]
    wrong = [] if problem is None else [f"{HEADER} {problem}"]
    found = _Verification(store, header, manifest, deep, strays)
    found.bad_files |= {HEADER} if wrong else set()
    return wrong + list(found.problems())


class _Verification:
    def __init__(
        self, store: Store, header: Mapping[str, Any], manifest: Manifest, deep: bool, strays: bool
    ) -> None:
        self._store, self._header, self._manifest = store, header, manifest
        self._deep, self._strays = deep, strays
        self._folders: set[str] = set()
        self.bad_files: set[str] = set()

    def problems(self) -> Iterator[str]:
        yield from self._listed_files()
        split_of: dict[str, str] = {}
        counts = dict.fromkeys(SPLIT_NAMES, 0)
        damaged: list[str] = []
        # Frames of a subject are consecutive: memory holds the names of one folder at a time.
        for (split, subject), group in groupby(self._records(damaged), _PERSON):
            other = split_of.setdefault(subject, split)
            if other != split:
                yield f"subject {subject} is in {other} and in {split}"
            records = list(group)
            counts[split] += len(records)
            yield from self._frame_problems(split, subject, records)
        yield from damaged
        for split, count in counts.items():
            if count != self._header["frames"][split]:
                said = self._header["frames"][split]
                yield f"{split} has {counted(count, 'frame')}, the header says {said}"
        if self._strays:
            yield from self._stray_entries()

    def _line(self, error: DatasetError) -> str:
        """Return a store error's message, with the path relative to the data set."""
        return str(error).removeprefix(f"{self._store}/")

    def _records(self, damaged: list[str]) -> Iterator[_Record]:
        """Yield the records of valid lines; append the errors of others to ``damaged``."""
        indices: set[int] = set()
        for number, line in enumerate(self._manifest.lines(0, len(self._manifest))):
            try:
                record = self._manifest.parse(line, number)
            except DatasetError as error:
                damaged.append(str(error))
                continue
            if record["index"] in indices:
                damaged.append(f"{MANIFEST}: line {number + 1}: index {record['index']} again")
            indices.add(record["index"])
            yield record

    def _listed_files(self) -> Iterator[str]:
        """Yield problems of the files listed in the header, such as the manifest and shards."""
        for name, expected in self._header["files"].items():
            whole = self._deep or not name.endswith(".tar")
            problems = list(self._file_problems(name, expected, whole))
            yield from problems
            if problems:
                self.bad_files.add(name)

    def _file_problems(self, name: str, expected: _Record, whole: bool) -> Iterator[str]:
        """Yield differences of a file's size, and of its CRC32 if ``whole`` or known to a cloud."""
        try:
            size = self._store.size(name)
        except DatasetError as error:
            yield self._line(error)
            return
        recorded = checksum_of(expected)
        if size is None:
            yield f"{name} is missing"
        elif size != recorded["size"]:
            yield f"{name} has {size} bytes instead of {recorded['size']}"
        elif (whole or self._store.is_remote) and self._store.checksum(name) != recorded:
            yield f"{name} is not what was written: its CRC32 differs"

    def _frame_problems(
        self, split: str, subject: str, records: Sequence[_Record]
    ) -> Iterator[str]:
        """Yield problems of the images of one subject's consecutive frames."""
        images: set[tuple[str, int | None]] = set()
        for record in records:
            stored = StoredImages(self._store, record, float(self._header["depth_unit_mm"]))
            for layer, file in record["files"].items():
                name, offset = file["name"], file.get("offset")
                if (name, offset) in images:
                    yield f"{name} is in two records"
                    continue
                images.add((name, offset))
                problems = list(self._place_problems(file))
                yield from problems
                if self._deep and not problems and name not in self.bad_files:
                    try:
                        stored.read(layer)
                    except DatasetError as error:
                        yield self._line(error)
        names = {name for name, offset in images if offset is None}
        if names and self._strays:
            yield from self._unrecorded(f"{split}/{subject}", names)

    def _place_problems(self, file: _Record) -> Iterator[str]:
        """Yield problems of an image's place: its file's size, or its range in a shard."""
        if "offset" not in file:
            yield from self._file_problems(file["name"], file, whole=False)
            return
        listed, member = self._header["files"].get(file["name"]), file.get("member", "")
        if listed is None:
            yield f"{file['name']} ({member}) is not listed in {HEADER}"
        elif file["offset"] + file["size"] > listed["size"]:
            yield f"{file['name']} ({member}): its offset {file['offset']} lies behind the end"

    def _unrecorded(self, folder: str, images: set[str]) -> Iterator[str]:
        self._folders.add(folder)
        try:
            names = [f"{folder}/{name}" for name in self._store.names(folder)]
        except DatasetError:
            return  # its images are reported already
        yield from (self._stray(name) for name in names if name not in images)

    def _stray(self, name: str) -> str:
        return f"{name} {LOST if self.bad_files & {HEADER, MANIFEST} else STRAY}"

    def _stray_entries(self) -> Iterator[str]:
        """Yield unrecorded files in the splits; other top-level files are allowed."""
        listed = self._header["files"].keys() | {MANIFEST, SKIPPED}
        seen: dict[str, str] = {}
        top = self._store.names("")
        for name in sorted({*top} - listed):
            if name.endswith(".tar") and name.partition("-")[0] in SPLIT_NAMES:
                yield self._stray(name)
        for split in (split for split in SPLIT_NAMES if split in top):
            try:
                entries = self._store.names(split)
            except DatasetError as error:
                yield self._line(error)
                continue
            for entry in (entry for entry in entries if entry != METADATA):
                if entry in seen:
                    yield f"subject {entry} has a folder in {seen[entry]} and in {split}"
                seen[entry] = split
                name = f"{split}/{entry}"
                if name not in self._folders and name not in listed:
                    yield self._stray(name)
