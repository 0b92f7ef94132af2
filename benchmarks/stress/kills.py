"""Kill runs at random times: python -m benchmarks.stress kills [--count 20].

Each trial begins ``glsim generate``, ``eval`` or ``train`` in a process group of its own and ends
it with a signal at a random time, up to three times: the whole group, the parent alone, or one
worker (the parent, where there is none). Then the same command runs to its end. A data set must
hold the same bytes as an undisturbed one, an evaluation the same scores and figures, a training the
same weights, and no folder of temporary files may be left.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

from rich.console import Console
from rich.table import Table

_GLSIM = [sys.executable, "-m", "glsim"]
_DATA = ["--sensor", "ideal", "--crop", "48", "--subjects", "6", "--frames-per-subject", "40"]
_TRAINING_DATA = ["--crop", "128", "--subjects", "6", "--frames-per-subject", "4"]
_TRAINING_DATA += ["--split", "0.67,0.33,0"]
_SCORED_DATA = [*_DATA, "--split", "0,0,1"]
_FORMATS = ("png", "webdataset")
_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_VICTIMS = ("group", "parent", "worker")
_WAYS = tuple(product(_VICTIMS, _SIGNALS))
LIMIT_S = 1800.0

#: Returns a command line.
Case = Callable[[], list[str]]


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
    parser.add_argument(
        "--commands", default="generate,eval,train", help="some of generate,eval,train"
    )
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="glsim-kills-") as name:
        trials = _run(Path(name), options.seed, options.count, options.commands.split(","))
    return _report(trials)


def cases(folder: Path, commands: Sequence[str] = ("generate", "eval", "train")) -> dict[str, Case]:
    """Return the commands to disturb, without their ``-o``, by name.

    A case makes the data set that its command reads, in ``folder``, when it is first asked for.
    """
    found: dict[str, Case] = {}
    for format, workers in product(_FORMATS, (1, 2)):
        many = ["--workers", str(workers)]
        if "generate" in commands:
            command = [*_GLSIM, "generate", *_DATA, "--format", format, *many, "-q"]
            found[f"generate {format} {workers}"] = partial(list, command)
        if "eval" in commands and workers == 2:
            options = ["-d", "median", "-d", "bilateral", *many, "-q"]
            found[f"eval {format}"] = partial(_reader, folder, "eval", format, options)
    for format in _FORMATS if "train" in commands else ():
        options = ["mask-aware-small", "--steps", "6", "--resume", "-q"]
        for setting in ("validate_every=2", "validate_unit=steps", "batch=2"):
            options += ["--set", f"training.{setting}"]
        found[f"train {format}"] = partial(_reader, folder, "train", format, options)
    return found


def _reader(folder: Path, name: str, format: str, options: list[str]) -> list[str]:
    """Return the command of eval or train on a data set, which is made if it is not there."""
    data = folder / f"data-{name}-{format}"
    if not data.exists():
        content = _SCORED_DATA if name == "eval" else _TRAINING_DATA
        finish([*_GLSIM, "generate", *content, "--format", format, "-q", "-o", str(data)])
    place = [str(data)] if name == "eval" else ["--data", str(data)]
    return [*_GLSIM, name, *options, *place]


def _run(folder: Path, seed: int, count: int, commands: Sequence[str]) -> list[Trial]:
    rng = random.Random(seed)
    commanded = cases(folder, commands)
    # Each case meets every signal at every victim, in an order of its own.
    ways = {case: rng.sample(_WAYS, len(_WAYS)) for case in commanded}
    expected: dict[str, str] = {}
    seconds: dict[str, float] = {}
    trials = []
    for number in range(count):
        case = list(commanded)[number % len(commanded)]
        command = commanded[case]()
        if case not in expected:
            out = folder / f"undisturbed-{len(expected)}"
            started = time.monotonic()
            finish([*command, "-o", str(out)])
            seconds[case] = time.monotonic() - started
            expected[case] = content_of(out)
        out = folder / f"trial-{number}"
        command += ["-o", str(out)]
        victim, kind = ways[case][number // len(commanded) % len(_WAYS)]
        hits = sum(_hit(command, rng, seconds[case], victim, kind) for _ in range(3))
        trials.append(Trial(case, victim, kind, hits, _problem(command, out, expected[case])))
        print(f"{number + 1} of {count}", trials[-1], file=sys.stderr, flush=True)
        shutil.rmtree(out)
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
        process.wait(LIMIT_S)
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


def finish(command: list[str]) -> None:
    subprocess.run(command, check=True, timeout=LIMIT_S)


def _problem(command: list[str], out: Path, expected: str) -> str:
    """Run a command to its end; return what is wrong with its result, or nothing."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        return f"did not end within {LIMIT_S:.0f} s"
    if done.returncode != 0:
        return f"status {done.returncode}: {done.stderr.strip().splitlines()[-1:]}"
    if content_of(out) != expected:
        return "differs from the undisturbed run"
    # Single files are stale after ten seconds (glsim.files.atomic): a later run removes them.
    left = [p.name for p in out.rglob("*") if p.name == "temporary"]
    return f"left {left}" if left else ""


def content_of(out: Path) -> str:
    """Hash a data set's files, an evaluation's scores and figures, or a training's best weights."""
    best = out / "best.pt"
    if best.exists():
        from glsim.denoise import checkpoint

        weights = checkpoint.load(best)["model"]
        parts = [(name, weights[name].numpy().tobytes()) for name in sorted(weights)]
    elif (out / "rows.csv").exists():
        figures = sorted((out / "figures").iterdir())
        parts = [(p.name, p.read_bytes()) for p in (out / "table.tex", *figures)]
        parts.append(("rows.csv", _scores(out / "rows.csv")))
    else:
        files = sorted(p for p in out.rglob("*") if p.is_file() and p.name != "lock")
        parts = [(p.relative_to(out).as_posix(), p.read_bytes()) for p in files]
    digest = hashlib.blake2b(digest_size=16)
    for name, data in parts:
        digest.update(f"{name}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def _scores(rows: Path) -> bytes:
    """Return rows.csv as JSON, without the column of run times, which no two runs share."""
    with rows.open() as file:
        kept = [{k: v for k, v in row.items() if k != "time_ms"} for row in csv.DictReader(file)]
    return json.dumps(kept).encode()


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
