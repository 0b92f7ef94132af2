"""Verify a complete data set: compare its files with its header and manifest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from glsim.dataset.disk_format import MANIFEST, METADATA, SKIPPED
from glsim.dataset.reader import Dataset, Pair
from glsim.errors import DatasetError
from glsim.files.atomic import file_checksum
from glsim.settings.schema import SPLIT_NAMES


def verify(path: Path | str, deep: bool = False) -> list[str]:
    """Return the problems of a data set, one line each; an empty list if there are none.

    Checks the header, the manifest and its counts, that no subject is in two splits (by records
    and by folders), that every file exists with its size, and that every file in a split has a
    record. deep: also checks the CRC32 of every image. Never raises DatasetError.
    """
    root = Path(path)
    try:
        dataset = Dataset(root)
    except DatasetError as error:
        return [str(error)]
    return list(_problems(dataset, deep))


def _problems(dataset: Dataset, deep: bool) -> Iterator[str]:
    yield from _listed_files(dataset, deep)
    split_of: dict[str, str] = {}
    counts = dict.fromkeys(SPLIT_NAMES, 0)
    folders: set[Path] = set()
    try:
        # The frames of a subject are consecutive: only one folder at a time is in memory.
        for (split, subject), group in groupby(dataset, lambda p: (p.split, p.subject)):
            other = split_of.setdefault(subject, split)
            if other != split:
                yield f"subject {subject} is in {other} and in {split}"
            pairs = list(group)
            counts[split] = counts.get(split, 0) + len(pairs)
            if dataset.is_tree:
                folder = dataset.path / split / subject
                folders.add(folder)
                yield from _folder_problems(dataset.path, folder, pairs, deep)
    except DatasetError as error:
        yield str(error)
    else:
        for split, count in counts.items():
            expected = dataset.header["frames"].get(split, 0)
            if count != expected:
                yield f"{split} has {count} frames, the header says {expected}"
    yield from _stray_entries(dataset, folders)


def _listed_files(dataset: Dataset, deep: bool) -> Iterator[str]:
    """Check the files that the header lists: manifest, skipped, metadata, shards."""
    for name, expected in dataset.header["files"].items():
        whole = deep or not name.endswith(".tar")
        yield from _file_problems(dataset.path / name, name, expected, whole)


def _file_problems(
    path: Path, name: str, expected: Mapping[str, Any], whole: bool
) -> Iterator[str]:
    """Compare a file with its recorded size and, if ``whole``, its CRC32."""
    try:
        size = path.stat().st_size
    except OSError:
        yield f"{name} is missing"
        return
    if size != expected["size"]:
        yield f"{name} has {size} bytes instead of {expected['size']}"
    elif whole and file_checksum(path) != {
        "size": expected["size"],
        "crc32": expected["crc32"],
    }:
        yield f"{name} is not what was written: its CRC32 differs"


def _folder_problems(root: Path, folder: Path, pairs: list[Pair], deep: bool) -> Iterator[str]:
    recorded = {file["name"]: file for pair in pairs for file in pair.record["files"].values()}
    for name, file in recorded.items():
        yield from _file_problems(root / name, name, file, deep)
    if folder.is_dir():
        for path in sorted(folder.iterdir()):
            name = path.relative_to(root).as_posix()
            if name not in recorded:
                yield f"{name} is in no record"


def _stray_entries(dataset: Dataset, folders: set[Path]) -> Iterator[str]:
    """Find unrecorded files in the splits; the user's own files at the top are allowed."""
    root = dataset.path
    listed = dataset.header["files"].keys() | {MANIFEST, SKIPPED}
    seen: dict[str, str] = {}
    for split in SPLIT_NAMES:
        for shard in sorted(root.glob(f"{split}-*.tar")):
            if shard.name not in listed:
                yield f"{shard.name} is in no record"
        entries = sorted((root / split).iterdir()) if (root / split).is_dir() else []
        for path in entries:
            if path.is_dir() and path.name in seen:
                yield f"subject {path.name} has a folder in {seen[path.name]} and in {split}"
            seen[path.name] = split
            name = f"{split}/{path.name}"
            if path not in folders and name not in listed and path.name != METADATA:
                yield f"{name} is in no record"
