"""Data sets in object storage: header and manifest are copied to a cache, images are streamed."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from glsim.dataset.disk_format import HEADER, MANIFEST, MERGED_INDEX, STATE
from glsim.dataset.manifest import REPAIR
from glsim.dataset.schema import MAX_HEADER_BYTES, parse_header
from glsim.errors import DatasetError
from glsim.files.atomic import file_checksum, write_atomic
from glsim.files.cache_folder import cache_folder
from glsim.files.cloud import CloudFolder
from glsim.files.contents import text_hash

log = logging.getLogger(__name__)

#: Bytes from the end of the index of chunks that hold its last line, see ``header_problem``.
_INDEX_END_BYTES = 4096
#: Bytes between two members of a shard: a header and the rest of the last block, 512 each.
_TAR_BYTES = 1024


def mirror(remote: CloudFolder) -> Path:
    """Return a local folder with dataset.json, manifest.jsonl and the header's checksum.

    It lies in the cache of glsim ($GLSIM_CACHE, else ~/.cache/glsim), named by the URL and by what
    the header says, so that a data set that is made again gets another one; the manifest is only
    copied if the folder does not hold it. What is read from there is checked as on a local disk.
    Raises DatasetError if there is no complete data set, or the store or the cache fails.
    """
    data = remote.read(HEADER, MAX_HEADER_BYTES)
    if data is None:
        if remote.names(STATE):
            raise DatasetError(
                f"{remote}: is not complete: run glsim generate again with the same settings"
            )
        raise DatasetError(f"{remote}: is no data set of glsim: it has no {HEADER}")
    header = parse_header(data, f"{remote.where(HEADER)}:")
    folder = cache_folder() / "cloud" / text_hash(f"{remote.url} {text_hash(data.decode())}")
    write_atomic(data, folder / HEADER, sync=False)
    index = f"{STATE}/{MERGED_INDEX}"
    size = remote.size(index)
    if size:
        end = remote.read_range(index, max(0, size - _INDEX_END_BYTES), _INDEX_END_BYTES)
        write_atomic(end, folder / index, sync=False)
    recorded = header["files"].get(MANIFEST)
    found = file_checksum(folder / MANIFEST)
    wanted = None if recorded is None else {"size": recorded["size"], "crc32": recorded["crc32"]}
    if found is None or found != wanted:
        _copy(remote, MANIFEST, folder / MANIFEST, wanted)
    return folder


def _copy(remote: CloudFolder, name: str, file: Path, recorded: Mapping[str, int] | None) -> None:
    """Copy an object to a file. Raises DatasetError if its size is not the recorded one."""
    size = remote.size(name)
    if size is None:
        raise DatasetError(f"{remote.where(name)}: is missing: {REPAIR}")
    if recorded is not None and size != recorded["size"]:
        raise DatasetError(
            f"{remote.where(name)}: was changed after it was written ({size} bytes, "
            f"{recorded['size']} recorded): {REPAIR}"
        )
    log.info("%s: copying %.0f MB to %s", remote.where(name), size / 1e6, file.parent)
    remote.download(name, file)


def fetch_images(remote: CloudFolder, files: Mapping[str, Mapping[str, Any]]) -> dict[str, bytes]:
    """Read the images of a frame: layer -> bytes, truncated if the object ends before.

    files: the entry of its record. The layers of a frame lie one after another in its shard, and
    are read with one request, for a request takes longer than their bytes.
    """
    images: dict[str, bytes] = {}
    for name in dict.fromkeys(file["name"] for file in files.values()):
        own = {layer: file for layer, file in files.items() if file["name"] == name}
        start = min(file.get("offset", 0) for file in own.values())
        end = max(file.get("offset", 0) + file["size"] for file in own.values())
        if end - start > sum(file["size"] + _TAR_BYTES for file in own.values()):
            for layer, file in own.items():  # not as we write them: nothing between is read
                images[layer] = remote.read_range(name, file.get("offset", 0), file["size"])
            continue
        data = remote.read_range(name, start, end - start)
        for layer, file in own.items():
            first = file.get("offset", 0) - start
            images[layer] = data[first : first + file["size"]]
    return images
