"""Fuzzing of the file readers: each damaged file is read or skipped with a reason.

    python -m benchmarks.fuzz_sources [--mutations 2000] [--seed 0] [--format shape.bs]

Limits: 1 GB of address space more than the program itself takes, and 10 seconds per file.
"""

from __future__ import annotations

import argparse
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tests.support.mutations import Format
_EXTRA_BYTES = 1_000_000_000
_SECONDS = 10
_ALONE = 0.1  # share of files that are alone in their source: unit, axes, scale come from them


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mutations", type=int, default=2000, help="damaged files per format")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--format", default=None, help="default: all")
    arguments = parser.parse_args()
    from tests.support.mutations import formats

    signal.signal(signal.SIGALRM, _too_long)
    failures = 0
    with tempfile.TemporaryDirectory() as folder:
        all_formats = formats(Path(folder))
        _limit_memory()
        for name, format_ in all_formats.items():
            if arguments.format in (None, name):
                failures += _fuzz(name, format_, arguments.mutations, arguments.seed)
    print(
        f"largest resident size {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB"
    )
    sys.exit(1 if failures else 0)


def _fuzz(name: str, format_: Format, mutations: int, seed: int) -> int:
    """Read damaged copies of one file; return the number of failures."""
    from tests.support.mutations import mutate

    outcomes: Counter[str] = Counter()
    slowest, started = 0.0, time.monotonic()
    for number in range(mutations):
        rng = np.random.default_rng([seed, number])
        data = mutate(format_.data, rng)
        began = time.monotonic()
        signal.alarm(_SECONDS)
        try:
            reason = format_.outcome(data, bool(rng.random() < _ALONE))
            outcomes["used" if reason is None else "skipped"] += 1
            if reason is not None and ("\n" in reason or not reason.strip()):
                outcomes["FAILED"] += 1
                print(f"{name} {number}: the reason is empty or has several lines: {reason!r}")
        except Exception as error:
            outcomes["FAILED"] += 1
            print(f"{name} {number}: {type(error).__name__}: {error}")
        finally:
            signal.alarm(0)
        slowest = max(slowest, time.monotonic() - began)
    counts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items()))
    took = time.monotonic() - started
    print(
        f"{name}: {mutations} files: {counts}; slowest {slowest:.2f} s, all {took:.0f} s",
        flush=True,
    )
    return outcomes["FAILED"]


def _limit_memory() -> None:
    """Make an allocation of more than 1 GB by a reader raise MemoryError."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + _EXTRA_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _too_long(signal_number: int, frame: object) -> None:
    raise TimeoutError(f"more than {_SECONDS} s")


if __name__ == "__main__":
    main()
