"""Reading of dataset.json and manifest.jsonl, with comparison to their recorded checksums."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from glsim.core.errors import DatasetError, counted
from glsim.core.files.atomic import checksum, parse_json, wrap_read_errors
from glsim.core.files.cloud import cloud_url, open_store
from glsim.core.files.contents import text_hash
from glsim.core.files.listing import entries
from glsim.core.files.regular import open_regular
from glsim.core.files.store import Store
from glsim.data.disk_format import COMPLETE, FORMAT, HEADER, MANIFEST, STATE
from glsim.data.map_files import READ_ONLY, SUFFIXES
from glsim.data.record_schema import (
    MAX_HEADER_BYTES,
    MAX_LINE_BYTES,
    checksum_of,
    parse_checksum,
    parse_frame,
    parse_header,
    refuse_newer,
)
from glsim.data.recordings.streams import STREAMS

_BLOCK_BYTES = 1 << 24
#: Smallest mean length of a manifest's lines, bytes; the common keys of a record take 200. With
#: shorter lines, the index of the lines would be larger than the file.
_LEAST_LINE_BYTES = 64
#: Number of lines read at a time, since the next records are often asked for next; chosen.
_NEAR = 32
#: Files in a folder of results of glsim, which is neither data set nor recording -> what it is.
_RESULTS: Final = {
    ("table.md", "rows.csv"): "holds scores of glsim eval: read its table.md or report.html",
    ("table.md", "scores.json"): "holds scores of glsim eval-real: read its table.md",
    ("recipe.json", "run.json"): "is a run of glsim train: glsim denoise NOISY -d {}/best.pt",
}
#: Last words of messages about damage: how to repair it.
REPAIR = "run glsim generate again with the same settings to repair it"


class Manifest:
    """The indexed lines of a manifest; opening it reads the whole file once, for its ``checksum``.

    Raises DatasetError if the file is missing or cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        ends: list[NDArray[np.int64]] = []
        size = crc32 = 0
        with wrap_read_errors(self.path), self._open() as lines:
            while block := lines.read(_BLOCK_BYTES):
                feeds = np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n"))
                ends.append(feeds + (size + 1))
                crc32 = isal_zlib.crc32(block, crc32)
                size += len(block)
                if _LEAST_LINE_BYTES * sum(map(len, ends)) > size:
                    raise DatasetError(f"{self.path}: is damaged: holds empty lines: {REPAIR}")
        self._ends = np.concatenate(ends) if ends else np.zeros(0, np.int64)
        self._near = -1, list[bytes]()  # the lines that were read last, and the first one's number
        self.checksum = {"size": size, "crc32": crc32}

    def __len__(self) -> int:
        return len(self._ends)

    def record(self, number: int) -> dict[str, Any]:
        """Return the checked record of line ``number``, from 0. Raises DatasetError if bad."""
        first, (begun, lines) = number - number % _NEAR, self._near
        if begun != first:
            lines = list(self.lines(first, min(_NEAR, len(self) - first)))
            self._near = first, lines
        return self.parse(lines[number - first], number)

    def lines(self, first: int, count: int) -> Iterator[bytes]:
        """Yield ``count`` lines from ``first`` on, cut after MAX_LINE_BYTES + 1 bytes."""
        start = int(self._ends[first - 1]) if first else 0
        with wrap_read_errors(self.path), self._open() as lines:
            lines.seek(start)
            for number in range(first, first + count):
                size = int(self._ends[number]) - start
                if size > MAX_LINE_BYTES:
                    yield lines.read(MAX_LINE_BYTES + 1)
                    lines.seek(start + size)
                else:
                    yield lines.read(size)
                start += size

    def parse(self, line: bytes, number: int) -> dict[str, Any]:
        """Parse and check a line. Raises DatasetError with file, line and field."""
        if len(line) > MAX_LINE_BYTES:
            raise self.damage(number, f"it has more than {MAX_LINE_BYTES} bytes")
        try:
            return parse_frame(line, self._line(number))
        except DatasetError as error:
            raise DatasetError(f"{error}: {REPAIR}") from None

    def damage(self, number: int, problem: str) -> DatasetError:
        """Return a DatasetError that reports a damaged line."""
        return DatasetError(f"{self._line(number)} is damaged: {problem}: {REPAIR}")

    def _line(self, number: int) -> str:
        return f"{self.path}: line {number + 1}"

    def _open(self) -> IO[bytes]:
        return open_regular(self.path, inside=self.path.parent)


def is_dataset(place: Path | str) -> bool:
    """Return whether a path holds a data set, complete or not; True for every URL."""
    path = Path(place)
    return cloud_url(place) is not None or (path / HEADER).exists() or (path / STATE).exists()


def results_in(folder: Path) -> str:
    """Say which results of glsim a folder holds and how to use them; "" for other places."""
    texts = (t for names, t in _RESULTS.items() if all((folder / n).is_file() for n in names))
    return next(texts, "").format(folder)


def _other_than_set(place: str) -> str:
    """Say what a place without dataset.json is, and which commands read it."""
    path = Path(place)
    if results := results_in(path):
        return results
    if not path.exists() and cloud_url(place) is None:
        return "no such folder"
    text = f"is no data set of glsim: it has no {HEADER}"
    above = (folder for folder in path.absolute().parents if (folder / HEADER).is_file())
    if data_set := next(above, None):
        return f"{text}, but {data_set} is one: give that"
    ends = (*SUFFIXES, *READ_ONLY, *STREAMS)
    if any(entries(each, ends)[0] for each in (path, path / "depth") if each.is_dir()):
        return (
            f"{text}; depth maps of a camera: glsim inspect {path}, glsim adapt {path}, glsim "
            f"eval-real {path}; glsim import {path} -o NEW makes a data set of them"
        )
    return f"{text}; glsim generate -o NEW makes one"


def read_header(place: Path | str) -> dict[str, Any]:
    """Read and check dataset.json. Raises DatasetError if it is absent or unreadable."""
    return _read_header(open_store(place))[0]


def simulated_by(header: Mapping[str, Any]) -> str:
    """Return the sensor whose noise a data set has; "" for an imported recording."""
    return str(header["settings"]["sensor"]) if header["sensor"].get("stages") else ""


def open_header(store: Store) -> tuple[dict[str, Any], str | None, Manifest]:
    """Return the header, the problem with its checksum (None if right), and the manifest."""
    header, data = _read_header(store)
    recorded = header["files"].get(MANIFEST)
    expected = None if recorded is None else checksum_of(recorded)
    present, key = checksum(data), text_hash(data.decode())
    store.local(HEADER, present, key)
    store.after = dict(pairwise(name for name in header["files"] if name.endswith(".tar")))
    manifest = Manifest(store.local(MANIFEST, expected, key))
    return header, header_problem(store, present), manifest


def _read_header(store: Store) -> tuple[dict[str, Any], bytes]:
    data = store.read(HEADER, MAX_HEADER_BYTES)
    if data is None:
        if store.names(STATE):
            from glsim.data.state_folder import RunState  # not needed to read a data set

            parts = RunState(store).missing_parts()
            raise DatasetError(
                f"{store}: is not complete{parts and f' (missing: {parts})'}: run glsim "
                "generate again with the same settings"
            )
        raise DatasetError(f"{store}: {_other_than_set(str(store))}")
    where = store.where(HEADER)
    header = parse_json(data, where)
    if header.get("format") != FORMAT:
        raise DatasetError(f"{where}: is not the header of a glsim data set")
    refuse_newer(header, where)
    del header  # a parsed header takes a hundred times its size on disk
    return parse_header(data, f"{where}:"), data


def manifest_problem(header: Mapping[str, Any], manifest: Manifest) -> str | None:
    """Describe how a manifest differs from its entry in the header; None if they agree."""
    recorded = header["files"].get(MANIFEST)
    if recorded is not None and manifest.checksum != checksum_of(recorded):
        return f"was changed after it was written (its checksum is in {HEADER})"
    frames = sum(header["frames"].values())
    if len(manifest) != frames:
        return f"has {counted(len(manifest), 'line')}, {HEADER} says {frames}"
    return None


def header_problem(store: Store, present: Mapping[str, int]) -> str | None:
    """Describe how dataset.json differs from its checksum in .glsim; None if they agree.

    A data set without the folder .glsim, such as a copy, has no checksum of its header.
    """
    try:
        recorded = parse_checksum(store.read(COMPLETE, MAX_LINE_BYTES) or b"", COMPLETE)
    except DatasetError:
        return None  # no checksum, or one that a run writes again
    if present == checksum_of(recorded):
        return None
    return f"was changed after it was written (its checksum is in {STATE})"
