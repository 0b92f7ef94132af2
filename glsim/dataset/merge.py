"""From chunk records to the manifest, the metadata and the header; and back, to repair.

Everything here streams: memory does not grow with the number of frames.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any

from glsim.config import SPLIT_NAMES
from glsim.dataset.files import CheckedFile, check_of, read_json, to_json, write_file, writing
from glsim.dataset.layout import HEADER, MANIFEST, METADATA, SKIPPED, Plan
from glsim.dataset.record import ChunkRecord, Record, build_chunk, metadata_row, parse_head
from glsim.dataset.store import Store
from glsim.errors import DatasetError


def merge(store: Store, plan: Plan, identity: Mapping[str, Any]) -> None:
    """Write all files that describe the whole data set, then drop the chunk records.

    A function of the chunk records and ``identity`` alone: no clock, no number of workers.
    Raises DatasetError if a subject turns out to be in two splits.
    """
    files: dict[str, Any] = {}
    counts = dict.fromkeys(SPLIT_NAMES, 0)
    subjects: dict[str, dict[str, None]] = {split: {} for split in SPLIT_NAMES}
    skipped = 0
    index = store.merged_index
    with CheckedFile(index, store.temporary(index.name), sync=True) as heads:
        with ExitStack() as stack:

            def create(name: str) -> CheckedFile:
                temporary = store.temporary(name.replace("/", "-"))
                return stack.enter_context(CheckedFile(store.out / name, temporary, sync=True))

            names = [MANIFEST, SKIPPED]
            outputs = {name: create(name) for name in names}
            for chunk in plan:
                record = store.load(chunk.number)
                if record is None:
                    raise DatasetError(f"{store.out}: the record of chunk {chunk.number} is gone")
                heads.write(record.head.encode())
                outputs[MANIFEST].write("".join(record.frames).encode())
                outputs[SKIPPED].write("".join(record.skipped).encode())
                frames: list[Record] = [json.loads(line) for line in record.frames]
                subjects[chunk.split] |= dict.fromkeys(frame["subject"] for frame in frames)
                counts[chunk.split] += len(frames)
                skipped += record.summary.skipped
                if record.summary.shard is not None:
                    shard = record.summary.shard
                    files[shard["name"]] = {"size": shard["size"], "crc32": shard["crc32"]}
                elif frames:
                    name = f"{chunk.split}/{METADATA}"
                    if name not in outputs:
                        outputs[name] = create(name)
                    rows = [to_json(metadata_row(frame), name) + "\n" for frame in frames]
                    outputs[name].write("".join(rows).encode())
        files |= {name: output.check for name, output in outputs.items()}
        _refuse_shared_subjects(subjects)
        header = dict(identity) | {
            "frames": counts,
            "skipped": skipped,
            "subjects": {split: list(names) for split, names in subjects.items()},
            "files": dict(sorted(files.items())),
        }
        data = json.dumps(header, indent=1, allow_nan=False).encode() + b"\n"
        check = write_file(store.out / HEADER, data, store.temporary(HEADER), sync=True)
        heads.write(to_json(check, HEADER).encode() + b"\n")
    store.discard_chunks()


def _refuse_shared_subjects(subjects: Mapping[str, Mapping[str, None]]) -> None:
    seen: dict[str, str] = {}
    for split, names in subjects.items():
        for name in names:
            if name in seen:
                raise DatasetError(f"subject {name} is in {seen[name]} and in {split}")
            seen[name] = split


def merged_is_intact(store: Store, chunks: int) -> bool:
    """Whether the header, the manifest and the metadata are as they were written."""
    try:
        with store.merged_index.open(encoding="utf-8", errors="replace") as index:
            check = json.loads(next(islice(index, chunks, None), ""))
        if check_of(store.out / HEADER) != check:
            return False
        files = read_json(store.out / HEADER)["files"]
    except (OSError, ValueError, DatasetError):
        return False
    return all(
        check_of(store.out / name) == check
        for name, check in files.items()
        if name.endswith(".jsonl")
    )


def merged_chunks(store: Store, chunks: int) -> Iterator[ChunkRecord | None]:
    """Read the chunk records back from the manifest, in order; None for each damaged one.

    A line too many or too few spoils all later chunks: they are then rendered again.
    """
    with ExitStack() as stack:
        heads, frames, skipped = (
            _lines(stack, path)
            for path in (store.merged_index, store.out / MANIFEST, store.out / SKIPPED)
        )
        for _ in range(chunks):
            try:
                head = next(heads, "")
                summary = parse_head(head)
                yield build_chunk(
                    head,
                    list(islice(frames, summary.frames)),
                    list(islice(skipped, summary.skipped)),
                )
            except DatasetError:
                yield None


def _lines(stack: ExitStack, path: Path) -> Iterator[str]:
    try:
        return stack.enter_context(path.open(encoding="utf-8", errors="replace", newline="\n"))
    except OSError:
        return iter(())


def unmerge(store: Store, chunks: int, damaged: set[int]) -> None:
    """Turn a complete data set into a resumable one that lacks the ``damaged`` chunks."""
    for number, record in enumerate(merged_chunks(store, chunks)):
        if record is not None and number not in damaged:
            store.save(record)
    with writing(store.out):
        (store.out / HEADER).unlink(missing_ok=True)
        store.merged_index.unlink()
