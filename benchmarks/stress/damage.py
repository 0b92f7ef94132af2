"""How a kind of input is damaged: its bytes, the values of its JSON, the words of its text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.support import mutations

#: Values that take the place of a value in a JSON tree.
_VALUES: tuple[Any, ...] = (
    None, True, False, -1, 0, 1, 2**31, 2**63, 10**400, 0.5, -1e308, float("nan"), float("inf"),
    "", "x", "../outside.png", "/dev/zero", "a\0b", "\u202e\x1b[2J", "x" * 100_000,
    [], {}, [[]], [1] * 1000, {"x": {"y": []}},
)  # fmt: skip
#: Words that take the place of a word in a text.
_WORDS = (
    "0", "-1", "1e308", "1e999", "nan", "inf", "9" * 400, "99999999999", "1/0", "true", "''", "[]",
    "{}", "[" * 3000, "x" * 5000, "../x.toml", "/dev/zero", "=", "é\u202e", "\0", '"', "#", "1_0",
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    read raises GlsimErrors for what it refuses, or returns the reason.

    Attributes:
        change: makes a damaged copy; read: reads it; None if there was no error.
    """

    change: Callable[[np.random.Generator], None]
    read: Callable[[], str | None]


def bytes_kind(path: Path, read: Callable[[Path], object]) -> Kind:
    """A file whose bytes are damaged."""
    data = path.read_bytes()

    def change(rng: np.random.Generator) -> None:
        path.write_bytes(mutations.mutate(data, rng))

    def whole() -> None:
        read(path)

    return Kind(change, whole)


def change_value(tree: Any, rng: np.random.Generator) -> None:
    """Replace a value in a tree of JSON, or remove it, or nest it deeply."""
    places = list(_places(tree))
    node, key = places[int(rng.integers(len(places)))]
    choice = rng.random()
    if choice < 0.1:
        del node[key]
    elif choice < 0.15:
        for _ in range(300):
            node[key] = {"x": node[key]}
    else:
        node[key] = deepcopy(_VALUES[int(rng.integers(len(_VALUES)))])


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    items = list(tree.items() if isinstance(tree, dict) else enumerate(tree))
    for key, value in items:
        yield tree, key
        if isinstance(value, dict | list):
            yield from _places(value)


def change_words(text: str, rng: np.random.Generator) -> bytes:
    """Replace, remove or repeat a few words, numbers and lines of a text."""
    for _ in range(rng.integers(1, 4)):
        choice = rng.random()
        if choice < 0.7:
            words = list(re.finditer(r"-?[\w.]+|\S", text))
            word = words[int(rng.integers(len(words)))]
            other = words[int(rng.integers(len(words)))][0]
            new = other if rng.random() < 0.3 else _WORDS[int(rng.integers(len(_WORDS)))]
            text = text[: word.start()] + new + text[word.end() :]
        else:
            lines = text.splitlines(keepends=True)
            at = int(rng.integers(len(lines)))
            lines[at : at + 1] = [] if choice < 0.85 else [lines[at]] * int(rng.integers(2, 50))
            text = "".join(lines) or "x"
    return text.encode(errors="replace")
