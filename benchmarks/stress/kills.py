"""Kill runs at random times: python -m benchmarks.stress kills [--count 20].

Each trial begins ``glsim generate`` or ``glsim train`` in a process group of its own and ends it
with a signal at a random time, up to three times: the whole group, the parent alone, or one worker.
Then the same command runs to its end. A data set must hold the same bytes as an undisturbed one, a
training the same weights, and no folder of temporary files may be left.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

_GLSIM = [sys.executable, "-m", "glsim"]
_DATA = ["--sensor", "ideal", "--crop", "48", "--subjects", "6", "--frames-per-subject", "40"]
_TRAINING_DATA = ["--crop", "128", "--subjects", "6", "--frames-per-subject", "4"]
_TRAINING_DATA += ["--split", "0.67,0.33,0"]
#: Data sets: format, number of workers.
_DATA_CASES = (("png", 1), ("png", 2), ("webdataset", 1), ("webdataset", 2))
_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_VICTIMS = ("group", "parent", "worker")
_LIMIT_S = 300.0


@dataclass(frozen=True)
class Trial:
    """Result of a trial: the command, the signals that it got, and what is wrong, if anything."""

    case: str
    victim: str
    signal: signal.Signals
    hits: int
    problem: str


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials and print a table; returns 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stress kills", description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="number of trials")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-train", action="store_true", help="kill data sets only")
    options = parser.parse_args(arguments)
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="glsim-kills-") as name:
        trials = _run(Path(name), rng, options.count, train=not options.no_train)
    return _report(trials)


def _run(folder: Path, rng: random.Random, count: int, *, train: bool) -> list[Trial]:
    cases = [f"generate {format} {workers}" for format, workers in _DATA_CASES]
    commands = {
        case: [*_GLSIM, "generate", *_DATA, "--format", format, "--workers", str(workers), "-q"]
        for case, (format, workers) in zip(cases, _DATA_CASES, strict=True)
    }
    if train:
        data = folder / "training-data"
        _finish([*_GLSIM, "generate", *_TRAINING_DATA, "-q", "-o", str(data)])
        cases.append("train")
        commands["train"] = [*_GLSIM, "train", "mask-aware-small", "--data", str(data)]
        commands["train"] += ["--steps", "6", "--set", "training.validate_every=2", "--resume"]
        commands["train"] += ["--set", "training.validate_unit=steps", "-q"]
        commands["train"] += ["--set", "training.batch=2"]
    expected: dict[str, str] = {}
    seconds: dict[str, float] = {}
    trials = []
    for number in range(count):
        case = cases[number % len(cases)]
        if case not in expected:
            out = folder / f"undisturbed-{len(expected)}"
            started = time.monotonic()
            _finish([*commands[case], "-o", str(out)])
            seconds[case] = time.monotonic() - started
            expected[case] = _content(out)
        out = folder / f"trial-{number}"
        command = [*commands[case], "-o", str(out)]
        victim, kind = rng.choice(_VICTIMS), rng.choice(_SIGNALS)
        hits = sum(_hit(command, rng, seconds[case], victim, kind) for _ in range(3))
        trials.append(Trial(case, victim, kind, hits, _problem(command, out, expected[case])))
    return trials


def _hit(
    command: list[str], rng: random.Random, seconds: float, victim: str, kind: signal.Signals
) -> bool:
    """Start a command and send a signal at a random time; returns whether it still ran."""
    process = subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    with suppress(subprocess.TimeoutExpired):
        process.wait(rng.uniform(0.0, seconds))
        return False
    workers = _children(process.pid)
    with suppress(ProcessLookupError):
        if victim == "group":
            os.killpg(process.pid, kind)
        else:
            chosen = rng.choice(workers) if victim == "worker" and workers else process.pid
            os.kill(chosen, kind)
    try:
        process.wait(_LIMIT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return True


def _children(pid: int) -> list[int]:
    try:
        return [
            int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        ]
    except OSError:
        return []


def _finish(command: list[str]) -> None:
    subprocess.run(command, check=True, timeout=_LIMIT_S)


def _problem(command: list[str], out: Path, expected: str) -> str:
    """Run a command to its end; return what is wrong with its result, or nothing."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S)
    except subprocess.TimeoutExpired:
        return f"did not end within {_LIMIT_S:.0f} s"
    if done.returncode != 0:
        return f"status {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"
    if _content(out) != expected:
        return "differs from the undisturbed run"
    # Single files are stale after ten seconds (glsim.files.atomic): a later run removes them.
    left = [p.name for p in out.rglob("*") if p.name == "temporary"]
    return f"left {left}" if left else ""


def _content(out: Path) -> str:
    """Hash a data set's files, or a training's best weights."""
    best = out / "best.pt"
    if best.exists():
        from glsim.denoise import checkpoint

        weights = checkpoint.load(best)["model"]
        parts = [(name, weights[name].numpy().tobytes()) for name in sorted(weights)]
    else:
        files = sorted(p for p in out.rglob("*") if p.is_file() and p.name != "lock")
        parts = [(p.relative_to(out).as_posix(), p.read_bytes()) for p in files]
    digest = hashlib.blake2b(digest_size=16)
    for name, data in parts:
        digest.update(f"{name}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def _report(trials: Sequence[Trial]) -> int:
    table = Table("case", "victim", "signal", "hits", "result")
    for trial in trials:
        result = trial.problem or "same"
        table.add_row(trial.case, trial.victim, trial.signal.name, str(trial.hits), result)
    failures = sum(bool(trial.problem) for trial in trials)
    console = Console()
    console.print(table)
    hits = sum(trial.hits for trial in trials)
    console.print(f"{len(trials)} trials, {hits} signals, {failures} failures")
    return 1 if failures else 0
