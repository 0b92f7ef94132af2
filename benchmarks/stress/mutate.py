"""Read damaged inputs of every kind: each is used, or refused in one line.

    python -m benchmarks.stress mutate [--count 500] [--kinds all] [--seed 0] [--keep DIR]

A kind runs in a process of its own. A failure is an exception that is no GlsimError, a message of
several lines or of more than 2,500 characters, 20 seconds, 1 GB, or the end of the process. Prints
a table; the exit status is 1 if anything failed. A driver or a runtime of ONNX gets a process for
each input: a crash of its compiler is listed, and is no failure of glsim's.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.stress.kinds import KINDS
from benchmarks.stress.networks import CRASH

_SECONDS = 20
_BYTES = 1_000_000_000
_MESSAGE = 2500
_SHOWN = 5


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--count", type=int, default=500, help="damaged inputs of each kind")
    parser.add_argument("--kinds", default="all", help=f"all, or some of {','.join(KINDS)}")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the inputs that failed")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    names = list(KINDS) if options.kinds == "all" else options.kinds.split(",")
    if unknown := set(names) - KINDS.keys():
        parser.error(f"no such kind: {', '.join(sorted(unknown))}")
    if options.one:
        print(json.dumps(run_kind(names[0], options.count, options.seed, options.keep)))
        return 0
    print(
        f"{'kind':16}{'inputs':>8}{'used':>7}{'refused':>9}{'failed':>8}{'slowest s':>11}{'MB':>6}"
    )
    failed = total = 0
    for name in names:
        result = _in_process(name, options)
        outcomes = result["outcomes"]
        failed += outcomes.get("failed", 0)
        total += options.count
        counts = (outcomes.get(key, 0) for key in ("used", "refused", "failed"))
        used, refused, wrong = counts
        print(
            f"{name:16}{options.count:8}{used:7}{refused:9}{wrong:8}{result['slowest_s']:11.2f}"
            f"{result['grown_mb']:6.0f}",
            flush=True,
        )
        for text in [*result["failures"][:_SHOWN], *result.get("crashes", [])]:
            print(f"    {text}")
    print(f"{total} inputs, {failed} failed")
    return 1 if failed else 0


def _in_process(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Run one kind in a new process; its end by a signal is a failure too."""
    command = [sys.executable, "-m", "benchmarks.stress", "mutate", "--one", "--kinds", name]
    command += ["--count", str(options.count), "--seed", str(options.seed)]
    command += ["--keep", str(options.keep)] if options.keep else []
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        text = f"the process ended with {done.returncode}: {done.stderr.strip()[-300:]}"
        result = {"outcomes": {"failed": 1}, "slowest_s": 0, "grown_mb": 0, "failures": [text]}
    return result


def run_kind(name: str, count: int, seed: int = 0, keep: Path | None = None) -> dict[str, Any]:
    """Read ``count`` damaged inputs of a kind in this process; return a row of the table.

    The row holds ``outcomes`` (used, refused, failed -> number), ``slowest_s`` of one input,
    ``grown_mb`` of the peak resident memory, and a text per failure and per crash.
    """
    from glsim.errors import GlsimError

    outcomes: Counter[str] = Counter()
    failures: list[str] = []
    crashes: list[str] = []
    slowest = 0.0
    for alarm in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(alarm, _too_long)
    with tempfile.TemporaryDirectory() as folder:
        kind = KINDS[name](Path(folder))
        _quietly(kind.read)
        _forget_peak()
        before = _peak_kb()
        for number in range(count):
            kind.change(np.random.default_rng([seed, zlib.crc32(name.encode()), number]))
            started = time.monotonic()
            _limit(_SECONDS)
            problem = None
            try:
                reason = _quietly(kind.read)
            except GlsimError as error:
                reason = str(error)
            except Exception as error:
                reason = None
                where = traceback.extract_tb(error.__traceback__)[-1]
                text = " ".join(str(error).split())[:150]
                problem = f"{type(error).__name__} at {where.filename}:{where.lineno}: {text}"
            finally:
                _limit(0)
            slowest = max(slowest, time.monotonic() - started)
            if reason is not None and ("\n" in reason or not 0 < len(reason) <= _MESSAGE):
                problem = f"a message of {len(reason)} characters: {reason[:150]!r}"
            grown = _peak_kb() - before
            if 1000 * grown > _BYTES and "memory" not in outcomes:
                problem, outcomes["memory"] = f"{grown / 1e3:.0f} MB", 1
            if problem is not None:
                outcomes["failed"] += 1
                failures.append(f"{name} {number}: {problem}")
                if keep is not None:
                    shutil.copytree(folder, keep / f"{name}-{number}", dirs_exist_ok=True)
            elif reason is not None and reason.startswith(CRASH):
                outcomes["crashed"] += 1
                crashes.append(f"{name} {number}: {reason}")
            else:
                outcomes["used" if reason is None else "refused"] += 1
    grown = _peak_kb() - before
    return {
        "outcomes": dict(outcomes),
        "slowest_s": slowest,
        "grown_mb": grown / 1e3,
        "failures": failures,
        "crashes": crashes,
    }


def _forget_peak() -> None:
    """Let the kernel forget the largest size of this process (Linux; getrusage never forgets)."""
    Path("/proc/self/clear_refs").write_text("5")


def _peak_kb() -> int:
    """Return the largest resident size of this process since ``_forget_peak``, kB."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0])


def _quietly(read: Any) -> str | None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reason: str | None = read()
    return reason


def _limit(seconds: int) -> None:
    """Raise TimeoutError after so much processor time, or ten times as long a wait; 0: never."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.alarm(10 * seconds)


def _too_long(_signal_number: int, _frame: object) -> None:
    raise TimeoutError(f"more than {_SECONDS} s")
