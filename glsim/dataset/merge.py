"""Merge chunk records into manifest, metadata and header; split them again for a repair.

All functions stream: memory does not grow with the number of frames.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any

from glsim.dataset.cards import croissant, hub_card
from glsim.dataset.chunks import ChunkPlan
from glsim.dataset.disk_format import CROISSANT, HEADER, MANIFEST, METADATA, README, SKIPPED
from glsim.dataset.header import read_header
from glsim.dataset.output_folder import OutputFolder
from glsim.dataset.records import (
    ChunkRecord,
    Record,
    checked_chunk_record,
    metadata_row,
    parse_first_line,
)
from glsim.dataset.schema import parse_checksum, parse_frame
from glsim.errors import DatasetError
from glsim.files.atomic import (
    AtomicFile,
    file_checksum,
    to_json,
    wrap_read_errors,
    write_atomic,
)
from glsim.files.regular import open_regular
from glsim.settings.schema import SPLIT_NAMES


def merge(folder: OutputFolder, plan: ChunkPlan, identity: Mapping[str, Any]) -> None:
    """Write all files that describe the whole data set, then delete the chunk records.

    The files depend only on the chunk records and ``identity``, not on the clock or the workers.
    Each is on the disk before the next is named; the header comes after all that it describes.
    Raises DatasetError if a subject is in two splits.
    """
    files: dict[str, Any] = {}
    counts = dict.fromkeys(SPLIT_NAMES, 0)
    subjects: dict[str, dict[str, None]] = {split: {} for split in SPLIT_NAMES}
    skipped = 0
    index = folder.merged_index
    with AtomicFile(index, folder.temporary_path(index.name)) as index_file:
        with ExitStack() as stack:

            def create(name: str) -> AtomicFile:
                temporary = folder.temporary_path(name.replace("/", "-"))
                return stack.enter_context(AtomicFile(folder.out / name, temporary))

            names = [MANIFEST, SKIPPED]
            outputs = {name: create(name) for name in names}
            for number in range(len(plan)):
                record, split = folder.load_chunk(number), plan.split_of(number)
                if record is None:
                    raise DatasetError(f"{folder.out}: the record of chunk {number} is gone")
                index_file.write(record.first_line.encode())
                outputs[MANIFEST].write("".join(record.frames).encode())
                outputs[SKIPPED].write("".join(record.skipped).encode())
                where = f"the record of chunk {number}:"
                frames: list[Record] = [parse_frame(line, where) for line in record.frames]
                subjects[split] |= dict.fromkeys(frame["subject"] for frame in frames)
                counts[split] += len(frames)
                skipped += record.summary.skipped
                if record.summary.shard is not None:
                    shard = record.summary.shard
                    files[shard["name"]] = {"size": shard["size"], "crc32": shard["crc32"]}
                elif frames:
                    name = f"{split}/{METADATA}"
                    if name not in outputs:
                        outputs[name] = create(name)
                    rows = [to_json(metadata_row(frame), name) + "\n" for frame in frames]
                    outputs[name].write("".join(rows).encode())
        files |= {name: output.checksum for name, output in outputs.items()}
        _refuse_shared_subjects(subjects)
        header = dict(identity) | {
            "frames": counts,
            "skipped": skipped,
            "subjects": {split: list(names) for split, names in subjects.items()},
        }
        files |= _write_cards(folder, header)
        header["files"] = dict(sorted(files.items()))
        data = json.dumps(header, indent=1, allow_nan=False).encode() + b"\n"
        temporary = folder.temporary_path(HEADER)
        checksum = write_atomic(data, folder.out / HEADER, temporary=temporary)
        index_file.write(to_json(checksum, HEADER).encode() + b"\n")
    folder.publish_merged(outputs.keys() | {README, CROISSANT})
    folder.discard_chunk_records()


def _write_cards(folder: OutputFolder, header: Mapping[str, Any]) -> dict[str, Any]:
    """Write README.md and croissant.json; return their names and checksums."""
    with wrap_read_errors(folder.out / MANIFEST), (folder.out / MANIFEST).open("rb") as manifest:
        sha256 = hashlib.file_digest(manifest, "sha256").hexdigest()
    cards = {README: hub_card(header), CROISSANT: croissant(header, sha256)}
    return {
        name: write_atomic(data, folder.out / name, temporary=folder.temporary_path(name))
        for name, data in cards.items()
    }


def _refuse_shared_subjects(subjects: Mapping[str, Mapping[str, None]]) -> None:
    seen: dict[str, str] = {}
    for split, names in subjects.items():
        for name in names:
            if name in seen:
                raise DatasetError(f"subject {name} is in {seen[name]} and in {split}")
            seen[name] = split


def merged_files_are_intact(folder: OutputFolder, chunks: int) -> bool:
    """Check that the header, the manifest, metadata and cards are as they were written."""
    try:
        with folder.merged_index.open(encoding="utf-8", errors="replace") as index:
            checksum = parse_checksum(next(islice(index, chunks, None), ""), index.name)
        if file_checksum(folder.out / HEADER) != checksum:
            return False
        files = read_header(folder.out)["files"]
    except (OSError, DatasetError):
        return False
    return all(
        file_checksum(folder.out / name) == checksum
        for name, checksum in files.items()
        if not name.endswith(".tar")
    )


def read_merged_chunks(folder: OutputFolder, chunks: int) -> Iterator[ChunkRecord | None]:
    """Read the chunk records back from the manifest, in order; None for each damaged one.

    An extra or missing line makes all later chunks invalid: they are then rendered again.
    """
    with ExitStack() as stack:
        first_lines, frames, skipped = (
            _lines(stack, path)
            for path in (folder.merged_index, folder.out / MANIFEST, folder.out / SKIPPED)
        )
        for _ in range(chunks):
            try:
                first_line = next(first_lines, "")
                summary = parse_first_line(first_line)
                yield checked_chunk_record(
                    first_line,
                    list(islice(frames, summary.frames)),
                    list(islice(skipped, summary.skipped)),
                )
            except DatasetError:
                yield None


def _lines(stack: ExitStack, path: Path) -> Iterator[str]:
    try:
        file = stack.enter_context(open_regular(path))
        return io.TextIOWrapper(file, encoding="utf-8", errors="replace", newline="\n")
    except OSError:
        return iter(())


def unmerge(folder: OutputFolder, chunks: int, damaged: set[int]) -> None:
    """Turn a complete data set into a resumable one that lacks the ``damaged`` chunks."""
    for number, record in enumerate(read_merged_chunks(folder, chunks)):
        if record is not None and number not in damaged:
            folder.save_chunk(record)
    folder.withdraw()
