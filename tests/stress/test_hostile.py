"""A few hostile data sets; ``python -m benchmarks.stress hostile`` opens all by every reader."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.stress import hostile
from benchmarks.stress.hostile import open_set
from benchmarks.stress.hostile_sets import SETS

pytestmark = pytest.mark.long

_QUICK = ("open_dataset", "verify", "denoise")


@pytest.mark.parametrize(
    ("format", "name"),
    [
        ("png", "sound"),
        ("png", "name ../"),
        ("png", "image links out"),
        ("png", "image is a pipe"),
        ("png", "split links to others"),
        ("png", "header links out"),
        ("png", "index links out"),
        ("png", "image with two sizes"),
        ("png", "records twice"),
        ("webdataset", "shard links out"),
        ("webdataset", "shard of 5 GB"),
    ],
)
def test_nothing_outside_a_hostile_set_is_read(format: str, name: str) -> None:
    for result in open_set(format, name, _QUICK):
        assert result.problem == "", result


def test_there_are_more_than_forty_sets() -> None:
    assert sum(map(len, SETS.values())) > 60


@pytest.mark.parametrize(
    ("read", "problem"),
    [
        (lambda root: (root.parent / "outside" / "map.png").read_bytes(), "touched outside: map"),
        (lambda root: [*(root.parent / "outside").iterdir()], "touched outside: outside"),
        (lambda root: Path("/etc/passwd").read_bytes(), "touched outside: /etc/passwd"),
        (lambda root: (root.parent / "outside" / "new").touch(), "touched outside: "),
        (lambda root: sys.stdout.write("Traceback"), "says 'Traceback'"),
        (lambda root: sys.stdout.write("a\x1b[2Jb"), r"says '\x1b'"),
        (lambda root: sys.stdout.write("x" * 3000), "a message too long"),
        (
            lambda root: sys.stdout.write("glsim: error: a\nglsim: error: b"),
            "not one line for one error",
        ),
        (lambda root: [0] * 200_000_000, "more than 1 GB"),
    ],
)
def test_failures_are_found(monkeypatch: pytest.MonkeyPatch, read: object, problem: str) -> None:
    def reader(root: Path, out: Path) -> int:
        read(root)  # type: ignore[operator]
        return 0

    monkeypatch.setitem(hostile.READERS, "bad", reader)
    results: Iterator[hostile.Result] = open_set("png", "sound", ["bad"])
    assert problem in next(results).problem
