"""Reading of objects in large blocks where requests follow each other, the next block in advance.

A request over a network takes 20 ms or more, longer than the decoding of a frame. A request that
does not follow another is made as it is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock

#: Bytes of the first block, and of the largest after doublings: some hundred frames, which take a
#: tenth of a second at 1 Gbit/s.
_FIRST_BYTES, _MOST_BYTES = 1 << 20, 1 << 24
#: Largest distance of two requests that follow each other, bytes: the record between two frames.
_GAP_BYTES = 1 << 16


@dataclass(frozen=True)
class _Block:
    """A part of an object that a thread reads; it may be shorter than ``size`` at the end."""

    name: str
    start: int
    size: int
    data: Future[bytes]

    def is_whole(self) -> bool:
        """Whether the block has arrived, and does not end with the object."""
        return self.data.done() and len(self.data.result()) == self.size

    def holds(self, name: str, start: int, end: int) -> bool:
        """Whether the block has the bytes of a request, or will have them."""
        within = name == self.name and self.start <= start and end <= self.start + self.size
        return within and not (self.data.done() and self.data.exception())


class ReadAhead:
    """A reader of parts of objects by ``fetch`` (name, start, size); threads may share it."""

    def __init__(self, fetch: Callable[[str, int, int], bytes]) -> None:
        self._fetch, self._lock = fetch, Lock()
        self._thread = ThreadPoolExecutor(1)
        self._blocks: deque[_Block] = deque(maxlen=2)
        self._name, self._end = "", 0
        self._next_bytes = 0  # of a block; 0 after a request that follows none

    def read(self, name: str, start: int, size: int) -> bytes:
        """Return ``size`` bytes of an object from byte ``start``, or fewer at its end."""
        with self._lock:
            block = self._block(name, start, size)
        if block is None:
            return self._fetch(name, start, size)
        begin = start - block.start
        return block.data.result()[begin : begin + size]

    def _block(self, name: str, start: int, size: int) -> _Block | None:
        """Return the block of a request, begun now if the request follows another."""
        held = next((b for b in self._blocks if b.holds(name, start, start + size)), None)
        begun = name == self._name or self._next_bytes > 0  # else a single request at a start
        after = 0 <= start - (self._end if name == self._name else 0) <= _GAP_BYTES
        self._name, self._end = name, start + size
        if held is None:
            if not (begun and after):
                self._next_bytes = 0
            elif size <= max(self._next_bytes, _FIRST_BYTES):
                return self._begin(name, start)
        elif held is self._blocks[-1] and held.is_whole() and held.size > 4 * size:
            # A frame may lie across the end: the next block begins two frames before it.
            self._begin(name, held.start + held.size - 2 * size)
        return held

    def _begin(self, name: str, start: int) -> _Block:
        size = max(self._next_bytes, _FIRST_BYTES)
        self._next_bytes = min(2 * size, _MOST_BYTES)
        block = _Block(name, start, size, self._thread.submit(self._fetch, name, start, size))
        self._blocks.append(block)
        return block
