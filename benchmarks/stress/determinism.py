"""The same frames in every way of making them: python -m benchmarks.stress determinism.

Each case, a source of faces or a preset, is rendered by ``glsim generate`` with one worker, two,
in parts and after damage, and by a script with two threads, in the reverse order, and under other
code of OpenBLAS and NumPy, as if by other processors. A way fails if a frame differs from those of
one worker, unless its arithmetic differs too: a run refuses to resume with such a one.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.stress.meshes import write_mesh
from glsim.errors import ConfigError, GlsimError, did_you_mean
from glsim.worker_processes import portable_environment

#: Compared; depth in steps so small that the last bits of a vertex show.
_LAYERS = ("clean", "noisy", "infrared", "reason")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "LP_NUM_THREADS")

#: What was made: image or mesh -> hash of its bytes.
Hashes = dict[str, str]
_Thing = TypeVar("_Thing")


@dataclass(frozen=True)
class Case:
    """Faces to render: options of ``glsim generate`` and their values, and settings."""

    options: Mapping[str, Any]
    settings: Sequence[str] = ("output.crop=128", "output.depth_unit_mm=0.1")

    @property
    def command(self) -> list[str]:
        """The arguments of ``glsim generate``."""
        options = [(f"--{name.replace('_', '-')}", str(v)) for name, v in self.options.items()]
        settings = [("--set", assignment) for assignment in self.settings]
        layers = ("--layers", ",".join(_LAYERS))
        return [word for pair in (*options, *settings, layers) for word in pair]


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


def cases(folder: Path, roots: Mapping[str, str]) -> dict[str, Case]:
    """Return the cases; ``folder`` gets meshes, ``roots`` are further sources and their paths."""
    meshes = folder / "meshes" / "anna"
    meshes.mkdir(parents=True)
    for suffix in ("obj", "ply", "glb"):
        write_mesh(meshes / f"face_{suffix}.{suffix}")
    fewer = {"frames_per_subject": 2}
    few = {"subjects": 4, "frames_per_subject": 4}
    room = ("output.crop=160", "output.depth_unit_mm=0.1")
    return {
        "procedural": Case({"source": "procedural", **few}),
        "varied": Case({"source": "procedural", "sensor": "any-depth-camera", **few}),
        "structured light": Case({"source": "procedural", "sensor": "kinect-v1", **few}),
        "folder": Case({"source": "folder", "root": str(meshes.parent)}),
        "people": Case({"source": "people", **few}),
        "office": Case({"preset": "office", **few}, room),
        "living room": Case({"preset": "living-room", **few}, room),
        "paper": Case({"preset": "paper", "source": "procedural", **few}),
        **{kind: Case({"source": kind, "root": path} | fewer) for kind, path in roots.items()},
    }


def ways() -> dict[str, Way]:
    """Return the ways to make the frames; the first is what the others are compared with."""
    threads = [dict.fromkeys(_THREADS, number) for number in ("1", "2")]
    kernels = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")
    return {
        "1 worker": Way(["--workers 1"]),
        "2 workers": Way(["--workers 2"]),
        "parts": Way(["--workers 1 --part 1/3", "--workers 2 --part 0/3", "--part 2/3"]),
        "repaired": Way(["--workers 2", "--workers 1"], damage=True),
        "script 1 thread": Way(environment=threads[0]),
        "script 2 threads": Way(environment=threads[1]),
        "script reversed": Way(reverse=True),
        **{name: Way(environment={"OPENBLAS_CORETYPE": name}) for name in kernels},
        "native": Way(["--workers 2 --native"]),
        "no AVX2": Way(environment={"NPY_DISABLE_CPU_FEATURES": _dispatched()}),
    }


def _dispatched() -> str:
    """Return all processor features for which NumPy has code of its own and which are here."""
    tables: Any = np._core._multiarray_umath  # type: ignore[attr-defined]
    here = tables.__cpu_features__
    return " ".join(name for name in tables.__cpu_dispatch__ if here.get(name))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the matrix and print a table; returns 1 if a way failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stress determinism",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--cases", help="some of them, with commas")
    parser.add_argument("--ways", help="some of them, with commas")
    parser.add_argument(
        "--root", action="append", default=[], metavar="SOURCE=PATH", help="one more source"
    )
    parser.add_argument("--script", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.script:
        case = Case(**json.loads(options.script[0]))
        print(json.dumps(script_hashes(case, reverse=options.script[1] == "reverse")))
        return 0
    roots = dict(root.split("=", 1) for root in options.root)
    with tempfile.TemporaryDirectory(prefix="glsim-determinism-") as name:
        folder = Path(name)
        every = cases(folder, roots)
        return compare(_some(every, options.cases), _some(ways(), options.ways), folder)


def _some(every: Mapping[str, _Thing], names: str | None) -> dict[str, _Thing]:
    """Return those with the names in a list with commas; all for None. Raises ConfigError."""
    chosen = list(every) if names is None else names.split(",")
    for name in chosen:
        if name not in every:
            raise ConfigError(f"no such case or way {name!r}: {did_you_mean(name, every)}")
    return {name: every[name] for name in chosen}


def compare(every: Mapping[str, Case], tried: Mapping[str, Way], folder: Path) -> int:
    """Make each case in each way, print the differences, and return 1 for one that is wrong."""
    table = Table("way", *every, title="frames and meshes that differ")
    first: dict[str, tuple[Hashes, str]] = {}
    failures = 0
    for number, (way_name, way) in enumerate(tried.items()):
        cells = []
        for case_name, case in every.items():
            out = folder / f"{number}-{case_name.replace(' ', '-')}"
            found, arithmetic = make(case, way, out)
            expected, expected_arithmetic = first.setdefault(case_name, (found, arithmetic))
            both = expected.keys() & found.keys()
            different = sum(expected[key] != found[key] for key in both)
            refused = arithmetic != expected_arithmetic
            if not refused:  # the first script brings the meshes
                first[case_name] = (found | expected, arithmetic)
            wrong = not both or (different > 0 and not refused)
            failures += wrong
            state = "FAILED" if wrong else "refused" if refused else "same"
            cells.append(f"{state} {different}/{len(both)}")
        table.add_row(way_name, *cells)
    Console(width=40 + 18 * len(every)).print(table)
    return int(failures > 0)


def make(case: Case, way: Way, out: Path) -> tuple[Hashes, str]:
    """Return the hashes of a case made in one way, and its arithmetic.

    Raises GlsimError with the text of a command that fails.
    """
    environment = os.environ | portable_environment() | dict(way.environment)
    if not way.runs:
        words = json.dumps({"options": dict(case.options), "settings": list(case.settings)})
        order = "reverse" if way.reverse else "forward"
        program = ["-W", "ignore", "-m", "benchmarks.stress", "determinism", "--script"]
        answer = json.loads(_output([*program, words, order], environment).splitlines()[-1])
        return answer["hashes"], answer["arithmetic"]
    for number, run in enumerate(way.runs):
        if number and way.damage:
            for image in sorted(out.rglob("*_noisy.png"))[::3]:
                image.write_bytes(image.read_bytes()[:-9])
        command = ["-m", "glsim", "generate", "-o", str(out), "-q", *case.command, *run.split()]
        _output(command, dict(os.environ))
    return dataset_hashes(out)


def _output(command: Sequence[str], environment: Mapping[str, str]) -> str:
    done = subprocess.run(
        [sys.executable, *command], capture_output=True, text=True, env=environment, check=False
    )
    if done.returncode:
        raise GlsimError(f"{' '.join(command)}: {done.stderr[-800:]}")
    return done.stdout


def dataset_hashes(out: Path) -> tuple[Hashes, str]:
    """Return the hashes of all images of a data set, and the arithmetic that made it."""
    from glsim.dataset import open_dataset

    hashes = {
        f"{pair.subject}/{pair.sequence}/{pair.frame}/{layer}": _hash(pair.image(layer))
        for pair in open_dataset(out)
        for layer in _LAYERS
    }
    header = json.loads((out / "dataset.json").read_text(encoding="utf-8"))
    return hashes, header["inputs"]["arithmetic"]


def script_hashes(case: Case, *, reverse: bool = False) -> dict[str, Any]:
    """Return the hashes of images and meshes that a script makes, and its arithmetic."""
    from glsim.dataset.arithmetic import fingerprint
    from glsim.faces.base import BadFace
    from glsim.frame import Skipped
    from glsim.gl.context import borrowed_context
    from glsim.pipeline import open_sources, simulate
    from glsim.plan.tasks import make_tasks
    from glsim.settings.schema import load_settings

    options = dict(case.options)
    preset, sensor = options.pop("preset", None), options.pop("sensor", None)
    if "source" in options:
        options["kind"] = options.pop("source")
    tree: dict[str, Any] = {"output": {"layers": list(_LAYERS)}}
    settings = load_settings(
        None, case.settings, tree | ({"sensor": sensor} if sensor else {}), options, preset
    )
    sources = open_sources(settings)
    tasks = list(make_tasks(settings, sources))
    hashes: Hashes = {}
    with borrowed_context(None) as context:
        for some in [[task] for task in reversed(tasks)] if reverse else [tasks]:
            for task, face in zip(some, sources[0].load([t.key for t in some]), strict=True):
                assert not isinstance(face, BadFace), face.error
                for part, mesh in (("face", face.mesh), *((p.region, p.mesh) for p in face.parts)):
                    key = f"{task.key.subject}/{task.key.sequence}/{task.key.frame}/mesh {part}"
                    hashes[key] = _hash(mesh.vertices_mm)
            layers = ("infrared",)
            for frame in simulate(settings, some, sources=sources, context=context, layers=layers):
                assert not isinstance(frame, Skipped), frame.why
                place = f"{frame.key.subject}/{frame.key.sequence}/{frame.key.frame}"
                hashes |= {f"{place}/{layer}": _hash(frame.image(layer)) for layer in _LAYERS}
        return {"hashes": hashes, "arithmetic": fingerprint(context)}


def _hash(array: Any) -> str:
    return hashlib.blake2b(np.ascontiguousarray(array).tobytes(), digest_size=8).hexdigest()
