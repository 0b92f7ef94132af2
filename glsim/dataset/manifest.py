"""Read manifest.jsonl: its checksum, the places of its lines, and one checked record a line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from glsim.dataset.record_schema import MAX_LINE_BYTES, parse_frame
from glsim.errors import DatasetError
from glsim.files.atomic import wrap_read_errors
from glsim.files.regular import open_regular

_BLOCK_BYTES = 1 << 24
#: Fewest bytes of a line on average: the keys that each record has take 200. Below it, the places
#: of the lines would take more memory than the file has bytes.
_LEAST_LINE_BYTES = 64
#: The end of messages about damage.
REPAIR = "run glsim generate again with the same settings to repair it"


class Manifest:
    """The lines of a manifest; the file is read once when it is opened.

    Raises DatasetError if it is missing or cannot be read.

    Attributes:
        checksum: its size and CRC32.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        parts: list[NDArray[np.int64]] = []
        size = crc32 = 0
        with wrap_read_errors(self.path), self._open() as lines:
            while block := lines.read(_BLOCK_BYTES):
                ends = np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n"))
                parts.append(ends + (size + 1))
                crc32 = isal_zlib.crc32(block, crc32)
                size += len(block)
                if _LEAST_LINE_BYTES * sum(map(len, parts)) > size:
                    raise DatasetError(f"{self.path}: is damaged: holds empty lines: {REPAIR}")
        self._ends = np.concatenate(parts) if parts else np.zeros(0, np.int64)
        self.checksum = {"size": size, "crc32": crc32}

    def __len__(self) -> int:
        return len(self._ends)

    def record(self, number: int) -> dict[str, Any]:
        """Return the checked record in a line, from 0. Raises DatasetError for a bad one."""
        return self.parse(next(self.lines(number, 1)), number)

    def lines(self, first: int, count: int) -> Iterator[bytes]:
        """Yield consecutive lines; of a line longer than MAX_LINE_BYTES only its start."""
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
        """Check a line. Raises DatasetError, which names the file, the line and the field."""
        if len(line) > MAX_LINE_BYTES:
            raise self.damage(number, f"it has more than {MAX_LINE_BYTES} bytes")
        try:
            return parse_frame(line, self._line(number))
        except DatasetError as error:
            raise DatasetError(f"{error}: {REPAIR}") from None

    def damage(self, number: int, problem: str) -> DatasetError:
        """Return the error for a bad line."""
        return DatasetError(f"{self._line(number)} is damaged: {problem}: {REPAIR}")

    def _line(self, number: int) -> str:
        return f"{self.path}: line {number + 1}"

    def _open(self) -> IO[bytes]:
        return open_regular(self.path, inside=self.path.parent)
