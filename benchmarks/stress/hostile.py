"""Open data sets that were made to do harm: python -m benchmarks.stress hostile [--sets TEXT].

Each reader opens each set of ``benchmarks.stress.hostile_sets`` in a process of its own. It fails
if it reads, lists or changes anything outside the set, or ends otherwise than with one line for an
error, within 20 s of processor time and 1 GB. ``verify --deep`` must find something in each set but
the harmless ones. Files outside are watched by the time of their last access, and by Python's audit
hook.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.stress.hostile_sets import SETS, make_box

_SECONDS = 20
#: Longest wait for a reader, s: it hangs then, however busy the machine is.
_WAIT_S = 240
_BYTES = 1_000_000_000
_MESSAGE = 2500
#: Sets that read as they say: their size is bounded, or what they add is not used.
HARMLESS = (
    "sound",
    "header repeats a key",
    "header of a million keys",
    "image of 8,192 x 8,192",
    "image with a comment of 600 MB",
    "state links out",
    "index links out",
    "index is a pipe",
)
_BAD_TEXT = re.compile(r"Traceback|\(a bug|[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_TOUCHED = "touched outside"
_WATCHED = ("/dev/zero", "/etc/passwd")


@dataclass(frozen=True)
class Result:
    """What a reader did with a set: its exit status, cost, last line, and what is wrong, if any."""

    set: str
    reader: str
    status: int
    seconds: float
    grown_mb: float
    said: str
    problem: str


def _open(root: Path, _out: Path) -> int:
    """Read every record and image by Python, as a user's own program does."""
    from glsim import open_dataset
    from glsim.errors import GlsimError

    status = 0
    try:
        pairs = iter(open_dataset(root))
        while True:
            try:
                pair = next(pairs)
                _ = pair.intrinsics, pair.clean_mm, pair.noisy_mm, repr(pair)
            except StopIteration:
                return status
    except GlsimError as error:
        print(f"glsim: error: {error}")
        return 1


def _command(*words: str) -> Callable[[Path, Path], int]:
    def run(root: Path, out: Path) -> int:
        from glsim.cli import main

        names = {"DATA": str(root), "OUT": str(out)}
        return main([names.get(word, word) for word in words])

    return run


_TRAIN = ("--steps", "1", "--set", "data.crop=16", "--set", "data.cut=centre")
#: Name -> a function of the set and of a folder for results, which returns an exit status.
READERS: dict[str, Callable[[Path, Path], int]] = {
    "open_dataset": _open,
    "verify": _command("verify", "DATA", "--deep"),
    "preview": _command("preview", "DATA", "-o", "OUT"),
    "eval": _command("eval", "DATA", "-d", "median", "--workers", "1", "--no-figures", "-o", "OUT"),
    "train": _command("train", "mask-aware-small", "--data", "DATA", *_TRAIN, "-q", "-o", "OUT"),
    "denoise": _command("denoise", "DATA", "-d", "median", "-o", "OUT"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Open each hostile data set by each reader; print a table. Returns 1 if a reader failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stress hostile",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--sets", default="", help="only sets whose names hold one of these texts")
    parser.add_argument("--readers", default=",".join(READERS), help="some of them")
    options = parser.parse_args(arguments)
    load_readers()
    print(f"{'set':36}{'reader':14}{'status':>7}{'s':>7}{'MB':>6}  said")
    sets = failures = 0
    for format in SETS:
        for name in ("sound", *SETS[format]):
            if not any(text in name for text in options.sets.split(",")):
                continue
            sets += name != "sound"
            for result in open_set(format, name, options.readers.split(",")):
                failures += bool(result.problem)
                said = f"FAILED: {result.problem}: {result.said}" if result.problem else result.said
                print(
                    f"{result.set:36}{result.reader:14}{result.status:7}{result.seconds:7.1f}"
                    f"{result.grown_mb:6.0f}  {ascii(said)[1:-1][:200]}",
                    flush=True,
                )
    print(f"{sets} hostile data sets, {failures} failures")
    return 1 if failures else 0


def load_readers() -> None:
    """Import what the readers need once: each process of a reader is a copy of this one."""
    import glsim.cli
    import glsim.eval.scoring.run
    import glsim.train.loop  # noqa: F401


def open_set(format: str, name: str, readers: Sequence[str]) -> Iterator[Result]:
    """Make a set, "sound" or one of SETS, and open it by each reader."""
    with tempfile.TemporaryDirectory(prefix="glsim-hostile-") as folder:
        box = Path(folder)
        make_box(box, format)
        if name != "sound":
            SETS[format][name](box / "set")
        for reader in readers:
            result = _read(box, name, reader)
            if result.problem.startswith(_TOUCHED):  # or did another program look there?
                result = _read(box, name, reader)
            yield result


def _read(box: Path, name: str, reader: str) -> Result:
    out = box / "out"
    watched = [box / "outside", *(box / "outside").rglob("*")]
    for path in watched:
        os.utime(path, (0, path.stat().st_mtime))
    before = [_state(path) for path in watched]
    base_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    pid = os.fork()
    if not pid:
        _run(box, READERS[reader])
    ended = _wait(pid)
    _, code, usage = os.wait4(pid, 0)
    seconds = usage.ru_utime + usage.ru_stime
    after = [_state(path) if path.exists() else None for path in watched]
    text = (box / "said").read_text(errors="surrogateescape")
    opened = (box / "opened").read_text() if (box / "opened").exists() else ""
    status = os.waitstatus_to_exitcode(code)
    grown_mb = max(0, usage.ru_maxrss - base_kb) / 1e3
    lines = [line for line in text.splitlines() if line.strip()]
    touched = [p.name for p, a, b in zip(watched, before, after, strict=True) if a != b]
    if touched or opened:
        problem = f"{_TOUCHED}: {', '.join(touched) or opened.splitlines()[0]}"
    elif not ended:
        problem = f"more than {_WAIT_S} s of waiting"
    else:
        problem = _bad_status(status) or _bad_output(text, lines, status, reader)
        if not problem and 1e6 * grown_mb > _BYTES:
            problem = "more than 1 GB"
    in_shards = reader == "denoise" and (box / "set" / "test-000000.tar").exists()
    if name == "sound" and status and not in_shards:  # denoise reads PNG files alone
        problem = problem or "refuses a sound set"
    elif reader == "verify" and not status and name not in HARMLESS:
        problem = problem or "verify finds nothing"
    shutil.rmtree(out, ignore_errors=True)
    said = lines[-1] if lines else ""
    return Result(name, reader, status, seconds, grown_mb, said, problem)


def _bad_status(status: int) -> str:
    if status == -signal.SIGXCPU:
        return f"more than {_SECONDS} s"
    return "" if status in (0, 1, 2) else f"ended by signal {-status}"


def _bad_output(text: str, lines: list[str], status: int, reader: str) -> str:
    if found := _BAD_TEXT.search(text):
        return f"says {found[0]!a}"
    errors = sum(line.startswith("glsim: error") for line in lines)
    if errors != (status != 0):
        return "" if reader == "verify" else "not one line for one error"
    return "a message too long" if max(map(len, lines), default=0) > _MESSAGE else ""


def _state(path: Path) -> tuple[int, ...]:
    status = path.lstat()
    return status.st_size, status.st_mtime_ns, status.st_atime_ns


def _wait(pid: int) -> bool:
    """Wait for a process; kill it after _WAIT_S. Returns whether it ended by itself."""
    handle = os.pidfd_open(pid)
    try:
        ended = bool(select.select([handle], [], [], _WAIT_S)[0])
        if not ended:
            os.kill(pid, signal.SIGKILL)
    finally:
        os.close(handle)
    return ended


def _run(box: Path, read: Callable[[Path, Path], int]) -> None:
    """Run a reader in this (new) process, with its output in a file, and end the process."""
    status = 3
    with contextlib.suppress(BaseException):
        said = os.open(box / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.stdout = sys.stderr = open(said, "w", closefd=False)  # noqa: SIM115 (until it ends)
        os.environ["NO_COLOR"] = "1"
        resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS + 1))
        _watch(box)
        status = read(box / "set", box / "out")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _watch(box: Path) -> None:
    """Write the name of each file outside the set that this process opens to a file."""
    outside = str(box / "outside")
    notes = os.open(box / "opened", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], str | Path):
            place = os.path.abspath(str(arguments[0]))  # noqa: PTH100 (links stay as they are)
            if place.startswith(outside) or place in _WATCHED:
                os.write(notes, f"{place}\n".encode())

    sys.addaudithook(hook)
