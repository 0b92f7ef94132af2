"""Merge chunk records into manifest, metadata and header; split them again for a repair.

All functions stream: memory does not grow with the number of frames.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from typing import IO, Any

from glsim.core.errors import DatasetError
from glsim.core.files.atomic import to_json
from glsim.core.files.store import Store
from glsim.data.chunks import CHUNK_FRAMES, ChunkPlan
from glsim.data.disk_format import HEADER, MANIFEST, METADATA, SKIPPED
from glsim.data.record_schema import (
    MAX_HEADER_BYTES,
    MAX_LINE_BYTES,
    parse_checksum,
    parse_frame,
    parse_header,
)
from glsim.data.records import (
    ChunkRecord,
    Record,
    checked_chunk_record,
    metadata_row,
    parse_first_line,
)
from glsim.data.run_state import INDEX, RunState
from glsim.settings.schema import SPLIT_NAMES


def merge(state: RunState, plan: ChunkPlan, identity: Mapping[str, Any]) -> None:
    """Write all files that describe the whole data set, then delete the chunk records.

    The files depend only on the chunk records and ``identity``, not on the clock or the workers.
    Each is on the disk before the next is named; the header comes after all that it describes.
    Raises DatasetError if a subject is in two splits.
    """
    files: dict[str, Any] = {}
    counts = dict.fromkeys(SPLIT_NAMES, 0)
    subjects: dict[str, dict[str, None]] = {split: {} for split in SPLIT_NAMES}
    skipped = 0
    store = state.store
    with store.create(INDEX) as index_file:
        with ExitStack() as stack:
            outputs = {n: stack.enter_context(store.create(n)) for n in (MANIFEST, SKIPPED)}
            for number, record in enumerate(store.map(state.load_chunk, range(len(plan)))):
                split = plan.split_of(number)
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
                        outputs[name] = stack.enter_context(store.create(name))
                    rows = [to_json(metadata_row(frame), name) + "\n" for frame in frames]
                    outputs[name].write("".join(rows).encode())
        files |= {name: output.checksum for name, output in outputs.items()}
        _refuse_shared_subjects(subjects)
        header = dict(identity) | {
            "frames": counts,
            "skipped": skipped,
            "subjects": {split: list(names) for split, names in subjects.items()},
        }
        header["files"] = dict(sorted(files.items()))
        data = json.dumps(header, indent=1, allow_nan=False).encode() + b"\n"
        index_file.write(to_json(store.put(HEADER, data), HEADER).encode() + b"\n")
    state.discard_chunks(range(len(plan)))


def _refuse_shared_subjects(subjects: Mapping[str, Mapping[str, None]]) -> None:
    seen: dict[str, str] = {}
    for split, names in subjects.items():
        for name in names:
            if name in seen:
                raise DatasetError(f"subject {name} is in {seen[name]} and in {split}")
            seen[name] = split


def merged_files_are_intact(state: RunState, chunks: int) -> bool:
    """Check that the header, the manifest and metadata are as they were written."""
    store = state.store
    try:
        with store.open(INDEX) as index:
            lines = bounded_lines(index, MAX_LINE_BYTES)
            checksum = parse_checksum(next(islice(lines, chunks, None), b""), INDEX)
        if store.checksum(HEADER) != checksum:
            return False
        files = parse_header(store.read(HEADER, MAX_HEADER_BYTES) or b"", HEADER)["files"]
    except (OSError, DatasetError):
        return False
    return all(
        store.checksum(name) == checksum
        for name, checksum in files.items()
        if not name.endswith(".tar")
    )


def read_merged_chunks(state: RunState, chunks: int) -> Iterator[ChunkRecord | None]:
    """Read the chunk records back from the manifest, in order; None for each damaged one.

    An extra or missing line makes all later chunks invalid: they are then rendered again.
    """
    with ExitStack() as stack:
        first_lines, frames, skipped = (
            _lines(stack, state.store, name) for name in (INDEX, MANIFEST, SKIPPED)
        )
        for _ in range(chunks):
            try:
                first_line = next(first_lines, "")
                summary = parse_first_line(first_line)
                if summary.total > max(CHUNK_FRAMES.values()):
                    raise DatasetError(f"chunk {summary.chunk} has {summary.total} frames")
                yield checked_chunk_record(
                    first_line,
                    list(islice(frames, summary.frames)),
                    list(islice(skipped, summary.skipped)),
                )
            except DatasetError:
                yield None


def _lines(stack: ExitStack, store: Store, name: str) -> Iterator[str]:
    try:
        file = stack.enter_context(store.open(name))
    except DatasetError:
        return iter(())
    return (line.decode(errors="replace") for line in bounded_lines(file, MAX_LINE_BYTES))


def unmerge(state: RunState, chunks: int, damaged: set[int]) -> None:
    """Turn a complete data set into a resumable one that lacks the ``damaged`` chunks."""
    for number, record in enumerate(read_merged_chunks(state, chunks)):
        if record is not None and number not in damaged:
            state.save_chunk(record)
    state.withdraw()


def bounded_lines(file: IO[bytes], limit: int) -> Iterator[bytes]:
    """Yield the lines of a file with their ends; long lines are cut.

    Args:
        file: open for reading.
        limit: longest whole line, bytes; a longer one is cut to ``limit`` + 1, so that it is known.
    """
    while line := file.readline(limit + 1):
        yield line
        rest = line
        while len(rest) > limit and not rest.endswith(b"\n"):
            rest = file.readline(limit + 1)
