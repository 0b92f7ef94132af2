"""Kill runs at random times: python -m benchmarks.kills [--count 20].

Each trial begins ``glsim generate``, ``eval`` or ``train`` in a process group of its own and ends
it with a signal at a random time, up to three times: the whole group, the parent alone, or one
worker (the parent, where there is none). Then the same command runs to its end. A data set must
hold the same bytes as an undisturbed one, an evaluation the same scores, a training the same
weights. At last parts start during a merge, and a part of another commit must be refused.
"""

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
from collections.abc import Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path

import glsim

_GLSIM = [sys.executable, "-m", "glsim"]
_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_WAYS = tuple(product(("group", "parent", "worker"), _SIGNALS))
_LIMIT_S = 1800.0


def commands(data: Path) -> dict[str, list[str]]:
    """Return the commands to disturb, without their ``-o``; ``data`` gets what they read."""
    few = ["--subjects", "6", "--frames-per-subject"]
    small = [*few, "40", "--sensor", "ideal", "--set", "output.crop=48"]
    people = [*few, "4", "--set", "output.crop=128"]
    generate = [*_GLSIM, "generate", "-q"]
    _finish([*generate, *small, "--set", "split=0,0,1", "-o", str(data / "scored")])
    _finish([*generate, *people, "--set", "split=0.67,0.33,0", "-o", str(data / "training")])
    train = [*_GLSIM, "train", "mask-aware-small", "-q", "--data", str(data / "training")]
    train += ["--steps", "6", "--set", "training.validate_unit=steps", "--resume"]
    train += ["--set", "training.validate_every=2", "--set", "training.batch=2"]
    generate += [*small, "--workers", "2", "--set"]
    return {
        **{f"generate {f}": [*generate, f"output.format={f}"] for f in ("png", "webdataset")},
        "eval": [*_GLSIM, "eval", str(data / "scored"), "-d", "median", "-d", "bilateral", "-q"],
        "train": train,
    }


def main() -> int:
    """Run the trials and print a line for each; returns 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="number of trials")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng, failures = random.Random(options.seed), 0
    with tempfile.TemporaryDirectory(prefix="glsim-kills-") as name:
        folder, expected = Path(name), {}
        cases = commands(folder)
        for case, command in cases.items():
            started = time.monotonic()
            _finish([*command, "-o", str(folder / case)])
            expected[case] = content_of(folder / case), time.monotonic() - started
        for number in range(options.count):
            case = list(cases)[number % len(cases)]
            victim, kind = rng.choice(_WAYS)
            out = folder / f"trial-{number}"
            command = [*cases[case], "-o", str(out)]
            content, seconds = expected[case]
            hits = sum(_hit(command, rng.uniform(0, seconds), victim, kind) for _ in range(3))
            problem = _problem(command, out, content)
            failures += bool(problem)
            print(f"{case}: {hits} {kind.name} to {victim}: {problem or 'same'}", flush=True)
            shutil.rmtree(out)
        for case, problem in _parts(cases["generate png"], folder, expected["generate png"][0]):
            failures += bool(problem)
            print(f"{case}: {problem or 'as it must be'}", flush=True)
    print(f"{options.count} trials, {failures} failures")
    return 1 if failures else 0


def _hit(command: list[str], after_s: float, victim: str, kind: signal.Signals) -> bool:
    """Start a command and send a signal after a time; returns whether it still ran."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, start_new_session=True, stdout=quiet, stderr=quiet)
    with suppress(subprocess.TimeoutExpired):
        process.wait(after_s)
        return False
    with suppress(ProcessLookupError):
        if victim == "group":
            os.killpg(process.pid, kind)
        else:
            workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            chosen = workers[0] if victim == "worker" and workers else process.pid
            os.kill(int(chosen), kind)
    try:
        process.wait(_LIMIT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return True


def _parts(generate: list[str], folder: Path, expected: str) -> Iterator[tuple[str, str]]:
    """Make a data set in 12 parts at once, and one by two commits; yield their problems."""
    part = [*generate, "--workers", "1", "-o", str(folder / "parts"), "--part"]
    runs = [subprocess.Popen([*part, f"{number}/12"]) for number in range(12)]
    same = {run.wait() for run in runs} == {0} and content_of(folder / "parts") == expected
    yield "parts at once", "" if same else "a failure, or other bytes"
    copy = Path(shutil.copytree(glsim.__path__[0], folder / "other" / "glsim"))
    (copy / "noise" / "__init__.py").write_text("# another commit")
    part[-2] = str(folder / "commits")
    _finish([*part, "0/2"])
    os.environ["PYTHONPATH"] = str(folder / "other")
    accepted = subprocess.call([*part, "1/2"], cwd=folder) != 2
    yield "a part of another commit", "was accepted" if accepted else ""


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
    if content_of(out) != expected:
        return "differs from the undisturbed run"
    # Single files are stale after ten seconds (glsim.core.files.atomic): a later run removes them.
    return "left temporary files" if any(out.rglob("temporary")) else ""


def content_of(out: Path) -> str:
    """Hash a data set's files, an evaluation's scores, or a training's best weights."""
    if (out / "best.pt").exists():
        from glsim.networks import checkpoint

        weights = checkpoint.load(out / "best.pt")["model"]
        parts = [(name, weights[name].numpy().tobytes()) for name in sorted(weights)]
    elif (out / "rows.csv").exists():
        read = csv.DictReader((out / "rows.csv").read_text().splitlines())
        rows = [{k: v for k, v in r.items() if k != "time_ms"} for r in read]  # times differ
        parts = [("rows.csv", json.dumps(rows).encode())]
    else:
        files = sorted(p for p in out.rglob("*") if p.is_file() and p.name != "lock")
        parts = [(p.relative_to(out).as_posix(), p.read_bytes()) for p in files]
    digest = hashlib.blake2b(digest_size=16)
    for name, data in parts:
        digest.update(f"{name}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


if __name__ == "__main__":
    sys.exit(main())
