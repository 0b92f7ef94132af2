"""Read a file line by line, however long its lines are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO


def bounded_lines(file: IO[bytes], limit: int) -> Iterator[bytes]:
    """Yield the lines of a file with their ends; of a longer one only its first bytes.

    Args:
        file: open for reading.
        limit: longest whole line, bytes; a longer one is cut to ``limit`` + 1, so that it is known.
    """
    while line := file.readline(limit + 1):
        yield line
        rest = line
        while len(rest) > limit and not rest.endswith(b"\n"):
            rest = file.readline(limit + 1)
