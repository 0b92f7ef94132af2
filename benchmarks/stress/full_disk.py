"""Fill the disk while data sets are written: python -m benchmarks.stress full_disk [--count 12].

Each trial gives ``glsim generate``, ``eval`` or ``train`` a folder on a tmpfs that is too small by
a random amount. The command must fail in one line that says so, without a traceback; once there is
room, the same command must end with the same bytes (scores, weights) as an undisturbed run.
Mounting needs root.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.stress.kills import LIMIT_S, cases, content_of, finish

_FULL = "No space left on device"
_ROOM_BYTES = 256_000_000


@dataclass(frozen=True)
class Trial:
    """A command's run on a disk of ``kilobytes``.

    Attributes:
        said: its last line.
        problem: "" if none.
    """

    case: str
    kilobytes: int
    said: str
    problem: str


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials and print a table; returns 1 if any failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stress full_disk", description=__doc__
    )
    parser.add_argument("--count", type=int, default=12, help="number of trials")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    rng = random.Random(options.seed)
    trials = []
    with tempfile.TemporaryDirectory(prefix="glsim-full-") as name:
        folder = Path(name)
        commands = {
            case: command
            for case, command in cases(folder).items()
            if case in ("generate png 1", "generate webdataset 1", "eval png", "train png")
        }
        expected: dict[str, tuple[str, int]] = {}
        for number in range(options.count):
            case = list(commands)[number % len(commands)]
            if case not in expected:
                out = folder / case.replace(" ", "-")
                finish([*commands[case](), "-o", str(out)])
                # Files take whole pages of a tmpfs.
                pages = sum(-(-p.stat().st_size // 4096) for p in out.rglob("*") if p.is_file())
                expected[case] = content_of(out), 4096 * pages
            content, size = expected[case]
            limit = int(rng.uniform(0.02, 0.95) * size)
            trials.append(_trial(folder, case, commands[case](), content, limit))
            print(f"{number + 1} of {options.count}", trials[-1], file=sys.stderr, flush=True)
    return _report(trials)


def _trial(folder: Path, case: str, command: list[str], content: str, limit: int) -> Trial:
    with _disk(folder / "disk", limit) as disk:
        command = [*command, "-o", str(disk / "out")]
        first = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
        lines = [line for line in first.stderr.splitlines() if line.strip()]
        said = lines[-1] if lines else ""
        problem = ""
        if first.returncode == 0:
            problem = "did not notice that the disk is full"
        elif "Traceback" in first.stderr or "a bug" in first.stderr or _FULL not in said:
            problem = "says something else than a full disk"
        _mount("remount", disk, _ROOM_BYTES)
        again = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
        if again.returncode != 0:
            problem = problem or f"does not go on: {again.stderr.splitlines()[-1:]}"
        elif content_of(disk / "out") != content:
            problem = problem or "differs from the undisturbed run"
    return Trial(case, limit // 1000, said, problem)


@contextmanager
def _disk(place: Path, size: int) -> Iterator[Path]:
    place.mkdir(exist_ok=True)
    _mount("", place, size)
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


def _mount(option: str, place: Path, size: int) -> None:
    options = ",".join(part for part in (option, f"size={size}") if part)
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)], check=True)


def _report(trials: Sequence[Trial]) -> int:
    table = Table("case", "disk [kB]", "said", "result")
    for trial in trials:
        said = trial.said.rpartition(": cannot write ")[2] or trial.said
        table.add_row(trial.case, str(trial.kilobytes), said[-70:], trial.problem or "same")
    failures = sum(bool(trial.problem) for trial in trials)
    console = Console()
    console.print(table)
    console.print(f"{len(trials)} full disks, {failures} failures")
    return 1 if failures else 0
