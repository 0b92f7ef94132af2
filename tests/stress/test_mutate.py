"""A few damaged inputs of every kind; ``python -m benchmarks.stress mutate`` reads thousands."""

from __future__ import annotations

import mmap
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.stress import kinds, mutate
from benchmarks.stress.damage import Kind
from benchmarks.stress.kinds import KINDS

pytestmark = pytest.mark.long


@pytest.mark.parametrize("name", KINDS)
def test_damaged_inputs_are_used_or_refused_in_one_line(name: str) -> None:
    result = mutate.run_kind(name, 6, seed=1)
    assert result["failures"] == []
    assert sum(result["outcomes"].values()) == 6


def _raise(error: Exception) -> str | None:
    raise error


def _take(size: int) -> str | None:
    """Fill memory that the process does not have yet; freed memory of the heap may stay with it."""
    with mmap.mmap(-1, size) as taken:
        for page in range(0, size, mmap.PAGESIZE):
            taken[page] = 1
    return None


@pytest.mark.parametrize(
    ("read", "problem"),
    [
        (lambda: _raise(KeyError("files")), "KeyError at"),
        (lambda: _raise(RecursionError("deep")), "RecursionError at"),
        (lambda: _raise(ValueError("two\nlines")), "ValueError at"),
        (lambda: "x" * 3000, "a message of 3000 characters"),
        (lambda: "two\nlines", "a message of 9 characters"),
        (lambda: "", "a message of 0 characters"),
        (lambda: _take(80_000_000), "MB"),
    ],
)
def test_failures_are_found(
    monkeypatch: pytest.MonkeyPatch, read: Callable[[], str | None], problem: str
) -> None:
    monkeypatch.setattr(mutate, "_BYTES", 40_000_000)
    calls: list[int] = []

    def first_good() -> str | None:
        calls.append(1)
        return read() if len(calls) > 1 else None

    kind = Kind(lambda rng: None, first_good)
    monkeypatch.setitem(kinds.KINDS, "bad", lambda folder: kind)
    result = mutate.run_kind("bad", 2)
    assert result["outcomes"]["failed"] >= 1
    assert problem in result["failures"][0]


def test_the_command_prints_a_table_and_says_what_failed(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.stress", "mutate", "--count", "2"]
    done = subprocess.run([*command, "--kinds", "png,glsl"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "4 inputs, 0 failed"
    assert subprocess.run([*command, "--kinds", "none"], capture_output=True).returncode == 2
