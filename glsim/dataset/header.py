"""Read dataset.json, and compare it and the manifest with their recorded checksums."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from glsim.dataset.disk_format import FORMAT, FORMAT_VERSION, HEADER, MANIFEST, MERGED_INDEX, STATE
from glsim.dataset.manifest import Manifest
from glsim.dataset.schema import MAX_HEADER_BYTES, parse_checksum, parse_header, read_object
from glsim.errors import DatasetError
from glsim.files.atomic import checksum
from glsim.files.regular import open_regular, read_regular

#: Bytes from the end of the index of chunks that surely hold its last line, the header's checksum.
_LAST_LINE_BYTES = 4096


def read_header(path: Path) -> dict[str, Any]:
    """Read and check dataset.json. Raises DatasetError if this version cannot read the data set."""
    file = path / HEADER
    if not file.exists():
        if (path / STATE).is_dir():
            raise DatasetError(
                f"{path}: is not complete: run glsim generate again with the same settings"
            )
        raise DatasetError(f"{path}: is no data set of glsim: it has no {HEADER}")
    header, data = read_object(file)
    if header.get("format") != FORMAT:
        raise DatasetError(f"{file}: is not the header of a glsim data set")
    version = header.get("format_version", 0)
    del header  # a large one takes a hundred times its bytes
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise DatasetError(
            f"{file}: format version {version} is newer than {FORMAT_VERSION}, "
            "which this glsim reads: update glsim"
        )
    return parse_header(data, f"{file}:")


def manifest_problem(header: Mapping[str, Any], manifest: Manifest) -> str | None:
    """Return how a manifest differs from what the header says of it; None if it does not."""
    recorded = header["files"].get(MANIFEST)
    if recorded is not None and manifest.checksum != {
        "size": recorded["size"],
        "crc32": recorded["crc32"],
    }:
        return f"was changed after it was written (its checksum is in {HEADER})"
    frames = sum(header["frames"].values())
    if len(manifest) != frames:
        return f"has {len(manifest)} lines, {HEADER} says {frames}"
    return None


def header_problem(path: Path) -> str | None:
    """Return that dataset.json differs from its checksum in .glsim; None if it does not.

    A data set without the folder .glsim, such as a copy, has no checksum of its header.
    """
    index = path / STATE / MERGED_INDEX
    try:
        with open_regular(index, inside=path) as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - _LAST_LINE_BYTES))
            last = file.read(_LAST_LINE_BYTES).splitlines()[-1:]
        recorded = parse_checksum(last[0] if last else b"", str(index))
        found = checksum(read_regular(path / HEADER, MAX_HEADER_BYTES, inside=path))
    except (OSError, DatasetError):
        return None  # no index, or one that a run writes again
    if found == {"size": recorded["size"], "crc32": recorded["crc32"]}:
        return None
    return f"was changed after it was written (its checksum is in {STATE})"
