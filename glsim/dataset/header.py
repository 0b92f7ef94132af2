"""Read dataset.json, and compare it and the manifest with their recorded checksums."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from glsim.dataset.disk_format import FORMAT, FORMAT_VERSION, HEADER, MANIFEST, MERGED_INDEX, STATE
from glsim.dataset.manifest import Manifest
from glsim.dataset.record_schema import MAX_HEADER_BYTES, parse_checksum, parse_header
from glsim.errors import DatasetError
from glsim.files.atomic import checksum, parse_json
from glsim.files.cloud import cloud_url, open_store
from glsim.files.contents import text_hash
from glsim.files.store import Store

_INDEX = f"{STATE}/{MERGED_INDEX}"
#: Bytes from the end of the index of chunks that surely hold its last line, the header's checksum.
_LAST_LINE_BYTES = 4096


class OpenHeader(NamedTuple):
    """A header, how its bytes differ from what was written, and the manifest beside it."""

    header: dict[str, Any]
    problem: str | None
    manifest: Manifest


def is_dataset(place: Path | str) -> bool:
    """Return whether a path names a data set of glsim, complete or not; a URL always does."""
    path = Path(place)
    return cloud_url(place) is not None or (path / HEADER).exists() or (path / STATE).exists()


def read_header(place: Path | str) -> dict[str, Any]:
    """Read and check dataset.json. Raises DatasetError if this version cannot read the data set."""
    return _read_header(open_store(place))[0]


def open_header(store: Store) -> OpenHeader:
    """Read the header and the manifest of a data set. Raises DatasetError as ``read_header``."""
    header, data = _read_header(store)
    recorded = header["files"].get(MANIFEST)
    expected = None if recorded is None else {n: recorded[n] for n in ("size", "crc32")}
    found = checksum(data)
    key = text_hash(data.decode())
    store.local(HEADER, found, key)
    manifest = Manifest(store.local(MANIFEST, expected, key))
    return OpenHeader(header, header_problem(store, found), manifest)


def _read_header(store: Store) -> tuple[dict[str, Any], bytes]:
    data = store.read(HEADER, MAX_HEADER_BYTES)
    if data is None:
        if store.names(STATE):
            raise DatasetError(
                f"{store}: is not complete: run glsim generate again with the same settings"
            )
        raise DatasetError(f"{store}: is no data set of glsim: it has no {HEADER}")
    where = store.where(HEADER)
    header = parse_json(data, where)
    if header.get("format") != FORMAT:
        raise DatasetError(f"{where}: is not the header of a glsim data set")
    version = header.get("format_version", 0)
    del header  # a large one takes a hundred times its bytes
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise DatasetError(
            f"{where}: format version {version} is newer than {FORMAT_VERSION}, "
            "which this glsim reads: update glsim"
        )
    return parse_header(data, f"{where}:"), data


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


def header_problem(store: Store, found: Mapping[str, int]) -> str | None:
    """Return that dataset.json differs from its checksum in .glsim; None if it does not.

    A data set without the folder .glsim, such as a copy, has no checksum of its header.
    """
    try:
        size = store.size(_INDEX) or 0
        start = max(0, size - _LAST_LINE_BYTES)
        tail = store.read_range(_INDEX, start, size - start)
        recorded = parse_checksum(tail.splitlines()[-1] if tail else b"", _INDEX)
    except DatasetError:
        return None  # no index, or one that a run writes again
    if found == {"size": recorded["size"], "crc32": recorded["crc32"]}:
        return None
    return f"was changed after it was written (its checksum is in {STATE})"
