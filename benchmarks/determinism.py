"""The same frames in every way of making them: python -m benchmarks.determinism.

Each case, a source of faces or a preset, is rendered by ``glsim generate`` with one worker, two,
in parts and after damage, and by a script with two threads, in the reverse order, and under other
code of OpenBLAS and NumPy, as if by other processors. A way fails if a frame differs from those of
one worker, unless its arithmetic differs too: a run refuses to resume with such a one.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from glsim.data.worker_processes import portable_environment

#: Compared; depth in steps so small that the last bits of a vertex show.
LAYERS = ("clean", "noisy", "infrared", "reason")
_SETTINGS = ("output.crop=160", "output.depth_unit_mm=0.1", "seed=3")
_FEW = {"subjects": 4, "frames_per_subject": 4}
#: Case -> preset, and settings of its source. Office needs ``glsim fetch people``.
CASES: Mapping[str, tuple[str | None, Mapping[str, Any]]] = {
    "procedural": (None, {"kind": "procedural"} | _FEW),
    "office": ("office", _FEW),
    "paper": ("paper", {"kind": "procedural"} | _FEW),
}


@dataclass(frozen=True)
class Way:
    """A way to make the frames.

    Args:
        runs: the further arguments of each ``glsim generate`` into one folder; none: by a script.
        damage: spoil images between the first and the second run.
        reverse: the script asks for one frame after the other, the last one first.
    """

    runs: Sequence[str] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    damage: bool = False
    reverse: bool = False


def ways() -> dict[str, Way]:
    """Return the ways to make the frames; the first is what the others are compared with."""
    tables: Any = np._core._multiarray_umath  # type: ignore[attr-defined]
    features = (n for n in tables.__cpu_dispatch__ if tables.__cpu_features__.get(n))
    threads = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "LP_NUM_THREADS")
    return {
        "1 worker": Way(["--workers 1"]),
        "2 workers": Way(["--workers 2"]),
        "parts": Way(["--workers 1 --part 1/3", "--workers 2 --part 0/3", "--part 2/3"]),
        "repaired": Way(["--workers 2", "--workers 1"], damage=True),
        "2 threads": Way(environment=dict.fromkeys(threads, "2")),
        "reversed": Way(reverse=True),
        "Prescott": Way(environment={"OPENBLAS_CORETYPE": "Prescott"}),
        "Haswell": Way(environment={"OPENBLAS_CORETYPE": "Haswell"}),
        "no AVX2": Way(environment={"NPY_DISABLE_CPU_FEATURES": " ".join(features)}),
    }


def main() -> int:
    """Run the matrix and print a line for each cell; returns 1 if a way failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.determinism", description=__doc__)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--script", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.script:
        print(json.dumps(_script(options.script[0], reverse=options.script[1] == "True")))
        return 0
    with tempfile.TemporaryDirectory(prefix="glsim-determinism-") as name:
        return compare(options.cases, ways(), Path(name))


def compare(cases: Iterable[str], tried: Mapping[str, Way], folder: Path) -> int:
    """Make each case in each way, print the differences, and return 1 if one is wrong."""
    failures = 0
    for case in cases:
        first: tuple[dict[str, str], str] | None = None
        for number, (name, way) in enumerate(tried.items()):
            found, arithmetic = make(case, way, folder / f"{case}-{number}")
            first = first or (found, arithmetic)
            different = sum(first[0].get(key) != value for key, value in found.items())
            refused = arithmetic != first[1]
            wrong = not found or (different > 0 and not refused)
            failures += wrong
            state = "FAILED" if wrong else "refused" if refused else "same"
            print(f"{case}, {name}: {state} {different}/{len(found)}", flush=True)
    return int(failures > 0)


def make(case: str, way: Way, out: Path) -> tuple[dict[str, str], str]:
    """Return the hash of each image of a case made in one way, and its arithmetic."""
    if not way.runs:
        environment = os.environ | portable_environment() | dict(way.environment)
        words = ["-W", "ignore", "-m", "benchmarks.determinism", "--script", case]
        hashes, arithmetic = json.loads(_output([*words, str(way.reverse)], environment))
        return hashes, arithmetic
    preset, source = CASES[case]
    settings = [*_SETTINGS, *(f"source.{name}={value}" for name, value in source.items())]
    command = ["-m", "glsim", "generate", "-o", str(out), "-q", "--set"]
    command += ["output.layers=" + ",".join(LAYERS)]
    command += [word for setting in settings for word in ("--set", setting)]
    command += ["--preset", preset] if preset else []
    for number, run in enumerate(way.runs):
        if number and way.damage:
            for image in sorted(out.rglob("*_noisy.png"))[::3]:
                image.write_bytes(image.read_bytes()[:-9])
        _output([*command, *run.split()], os.environ)
    from glsim.data.reader import open_dataset

    hashes = {
        f"{frame.key.subject}/{frame.key.sequence}/{frame.key.frame}/{layer}": _hash(
            frame.layer(layer)
            if layer in frame
            else np.rint(frame.layer(f"{layer}_mm") / frame.step_mm).astype(np.uint16)
        )
        for frame in open_dataset(out)
        for layer in LAYERS
    }
    header = json.loads((out / "dataset.json").read_text(encoding="utf-8"))
    return hashes, header["inputs"]["arithmetic"]


def _output(command: Sequence[str], environment: Mapping[str, str]) -> str:
    return subprocess.run(
        [sys.executable, *command], stdout=subprocess.PIPE, text=True, env=environment, check=True
    ).stdout


def _script(case: str, *, reverse: bool) -> tuple[dict[str, str], str]:
    """Return the hashes of images that a script makes, and its arithmetic."""
    from glsim.data.arithmetic import fingerprint
    from glsim.gl.context import borrowed_context
    from glsim.settings.schema import load_settings
    from glsim.simulation.frame import Skipped
    from glsim.simulation.pipeline import open_sources, simulate
    from glsim.simulation.plan.tasks import make_tasks

    preset, source = CASES[case]
    tree: Mapping[str, Any] = {"output": {"layers": list(LAYERS)}}
    settings = load_settings(None, _SETTINGS, tree, dict(source), preset)
    sources = open_sources(settings)
    tasks = list(make_tasks(settings, sources))
    hashes: dict[str, str] = {}
    with borrowed_context(None) as context:
        for some in [[task] for task in reversed(tasks)] if reverse else [tasks]:
            for frame in simulate(
                settings, some, sources=sources, context=context, layers=("infrared",)
            ):
                assert not isinstance(frame, Skipped), frame.why
                place = f"{frame.key.subject}/{frame.key.sequence}/{frame.key.frame}"
                hashes |= {f"{place}/{layer}": _hash(frame.image(layer)) for layer in LAYERS}
        return hashes, fingerprint(context)


def _hash(image: Any) -> str:
    return hashlib.blake2b(np.ascontiguousarray(image).tobytes(), digest_size=8).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
