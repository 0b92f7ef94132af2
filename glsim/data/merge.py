"""Merging of chunk records into the manifest, the metadata and the header.

Memory does not grow with the number of frames. Chunk records stay, to resume and repair runs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import IO, Any

from glsim.core.errors import DatasetError
from glsim.core.files.atomic import to_json
from glsim.data.chunks import ChunkPlan
from glsim.data.disk_format import COMPLETE, HEADER, MANIFEST, METADATA, SKIPPED
from glsim.data.record_schema import (
    MAX_HEADER_BYTES,
    MAX_LINE_BYTES,
    checksum_of,
    parse_checksum,
    parse_frame,
    parse_header,
)
from glsim.data.records import Record, metadata_row
from glsim.data.state_folder import RunState
from glsim.settings.schema import SPLIT_NAMES


def merge(state: RunState, plan: ChunkPlan, identity: Mapping[str, Any]) -> None:
    """Write the files that describe the whole data set: manifest, metadata and header.

    The files depend only on the chunk records and ``identity``, not on the clock or the workers.
    Each file is on the disk before the next is renamed into place; the header is last. Raises
    DatasetError if a subject is in two splits.
    """
    files: dict[str, Any] = {}
    counts = dict.fromkeys(SPLIT_NAMES, 0)
    split_of: dict[str, str] = {}
    skipped = 0
    store = state.store
    with ExitStack() as stack:
        outputs = {n: stack.enter_context(store.create(n)) for n in (MANIFEST, SKIPPED)}
        for number, record in enumerate(store.map(state.load_chunk, range(len(plan)))):
            split = plan.split_of(number)
            outputs[MANIFEST].write("".join(record.frames).encode())
            outputs[SKIPPED].write("".join(record.skipped).encode())
            where = f"the record of chunk {number}:"
            frames: list[Record] = [parse_frame(line, where) for line in record.frames]
            for name in (frame["subject"] for frame in frames):
                if (other := split_of.setdefault(name, split)) != split:
                    raise DatasetError(f"subject {name} is in {other} and in {split}")
            counts[split] += len(frames)
            skipped += record.summary.skipped
            if record.summary.shard is not None:
                files[record.summary.shard["name"]] = checksum_of(record.summary.shard)
            elif frames:
                name = f"{split}/{METADATA}"
                if name not in outputs:
                    outputs[name] = stack.enter_context(store.create(name))
                rows = [to_json(metadata_row(frame), name) + "\n" for frame in frames]
                outputs[name].write("".join(rows).encode())
    files |= {name: output.checksum for name, output in outputs.items()}
    header = dict(identity) | {
        "frames": counts,
        "skipped": skipped,
        "subjects": {s: [name for name, of in split_of.items() if of == s] for s in SPLIT_NAMES},
        "files": dict(sorted(files.items())),
    }
    data = json.dumps(header, indent=1, allow_nan=False).encode() + b"\n"
    store.put(COMPLETE, to_json(store.put(HEADER, data), HEADER).encode() + b"\n")


def merged_files_are_intact(state: RunState) -> bool:
    """Check that header, manifest and metadata have their recorded checksums."""
    store = state.store
    try:
        checksum = parse_checksum(store.read(COMPLETE, MAX_LINE_BYTES) or b"", COMPLETE)
        if store.checksum(HEADER) != checksum:
            return False
        files = parse_header(store.read(HEADER, MAX_HEADER_BYTES) or b"", HEADER)["files"]
    except DatasetError:
        return False
    return all(
        store.checksum(name) == checksum
        for name, checksum in files.items()
        if not name.endswith(".tar")
    )


def bounded_lines(file: IO[bytes], limit: int) -> Iterator[bytes]:
    """Yield the lines of an open file with their ends, each cut after ``limit`` + 1 bytes."""
    while line := file.readline(limit + 1):
        yield line
        rest = line
        while len(rest) > limit and not rest.endswith(b"\n"):
            rest = file.readline(limit + 1)
