"""Reading in advance gives the bytes of single requests, and in order it takes few of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from glsim.core.files.read_ahead import ReadAhead

RNG = np.random.default_rng(0)
OBJECTS = {name: RNG.bytes(size) for name, size in {"a": 5_000_000, "b": 1 << 20, "c": 70}.items()}
#: Name, start and size of frames of 20 to 70 kB, each followed by a record of some kB.
FRAMES = [
    (name, start, int(RNG.integers(20_000, 70_000)))
    for name, data in OBJECTS.items()
    for start in range(512, len(data), 75_000)
]


@pytest.mark.parametrize(
    ("order", "most"), [("forth", 15), ("back", len(FRAMES)), ("drawn", len(FRAMES))]
)
@pytest.mark.parametrize("threads", [1, 8])
def test_any_order_gives_the_bytes_of_single_requests(order: str, most: int, threads: int) -> None:
    frames = {"forth": FRAMES, "back": FRAMES[::-1], "drawn": RNG.permutation(FRAMES)}[order]
    asked: list[tuple[str, int, int]] = []

    def fetch(name: str, start: int, size: int) -> bytes:
        asked.append((name, start, size))
        return OBJECTS[name][start : start + size]

    def right(frame) -> bool:
        name, start, size = str(frame[0]), int(frame[1]), int(frame[2])
        return reader.read(name, start, size) == OBJECTS[name][start : start + size]

    reader = ReadAhead(fetch)
    with ThreadPoolExecutor(threads) as pool:
        assert all(pool.map(right, frames))
    assert len(asked) <= (most if threads == 1 else 2 * len(frames))


def test_a_failed_block_is_an_error_and_the_next_request_a_new_one() -> None:
    def fetch(name: str, start: int, size: int) -> bytes:
        if len(asked.append(start) or asked) in (2, 3):
            raise OSError("cut")
        return OBJECTS[name][start : start + size]

    asked: list[int] = []
    reader = ReadAhead(fetch)
    assert reader.read("a", 0, 10) == OBJECTS["a"][:10]
    for start in (10, 20):
        with pytest.raises(OSError, match="cut"):
            reader.read("a", start, 10)
    assert reader.read("a", 30, 10) == OBJECTS["a"][30:40]
