"""Test that mixed processors compute alike if asked, and that one that differs is refused."""

import os
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from glsim.core.errors import ConfigError, DatasetError
from glsim.data import arithmetic, chunks
from glsim.data.arithmetic import Machine, machine_of_workers
from glsim.data.chunk_writer import RenderJob
from glsim.data.chunks import parse_part
from glsim.data.code_version import code_version
from glsim.data.driver import generate, generate_part
from glsim.data.worker_processes import SINGLE_THREADED, portable_environment
from glsim.settings.schema import Settings, load_settings
from tests.support.dataset_fakes import TINY_SENSOR, contents


def tiny(folder: Path) -> Settings:
    (folder / "mine.toml").write_text(TINY_SENSOR)
    source = {"kind": "procedural", "subjects": 2, "frames_per_subject": 3}
    return load_settings(overrides={"sensor": str(folder / "mine.toml"), "source": source})


def test_a_worker_says_what_it_is_and_another_is_refused_by_name() -> None:
    machine = machine_of_workers({}, None)
    assert machine.host == platform.node()
    assert len(machine.arithmetic) == 16
    machine.refuse_other(machine)
    with pytest.raises(ConfigError, match=rf"{machine.host}: a worker computes differ"):
        machine.refuse_other(replace(machine, renderer="another renderer"))
    with pytest.raises(ConfigError, match=r"not llvmpipe, 0123\): give both the same"):
        Machine("node7", "llvmpipe", "4567").refuse_other(Machine("a", "llvmpipe", "0123"))


def test_code_that_decides_bytes_is_in_the_version(monkeypatch: pytest.MonkeyPatch) -> None:
    read, before = Path.read_bytes, code_version.__wrapped__()
    deciding = ("noise/chain.py", "heads.npz", "perlin.glsl", "core/files/png.py")
    for name in (*deciding, "cli/verify.py", "core/files/cloud.py", "data/reader.py", "v2.toml"):
        edited = lambda p, name=name: read(p) + b"#" * p.as_posix().endswith(name)  # noqa: E731
        monkeypatch.setattr(Path, "read_bytes", edited)
        assert (code_version.__wrapped__() != before) == (name in deciding), name
    with pytest.raises(ConfigError, match=r"glsim was changed during the run, 1\+b: run"):
        list(RenderJob(load_settings(), None, None, code="1+b").run([]))


def test_the_number_of_threads_does_not_make_another_machine() -> None:
    """Compute the same fingerprint with one thread, as workers do, and with four."""
    four = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "LP_NUM_THREADS")
    assert machine_of_workers({}, None) == machine_of_workers(dict.fromkeys(four, "4"), None)


def test_a_worker_that_cannot_start_is_one_clear_line() -> None:
    with pytest.raises(
        DatasetError, match=r"worker process \d+ ended with status 1, for the second"
    ):
        machine_of_workers({"PYTHONHOME": "/nowhere"}, None)


@pytest.mark.long
@pytest.mark.skipif(not portable_environment(), reason="NumPy has no code for AVX-512 here")
def test_pins_decide_and_are_quiet() -> None:
    """Instructions after Haswell's are left alone; the user's own choice is overruled."""
    pins = portable_environment()
    quiet = subprocess.run(
        [sys.executable, "-W", "error", "-c", "import numpy"],
        env=os.environ | pins,
        capture_output=True,
        text=True,
        check=True,
    )
    assert quiet.stderr == ""
    pinned = machine_of_workers(pins, None)
    older = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 " + pins["NPY_DISABLE_CPU_FEATURES"]}
    assert machine_of_workers({}, None).arithmetic != pinned.arithmetic
    assert machine_of_workers(older, None).arithmetic != pinned.arithmetic
    assert machine_of_workers(older | pins, None) == pinned


@pytest.mark.long
@pytest.mark.skipif(not portable_environment(), reason="NumPy has no code for AVX-512 here")
def test_a_portable_set_is_that_of_the_pinned_processor_whatever_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 3)
    settings = tiny(tmp_path)
    generate(settings, tmp_path / "a", workers=1, portable=True)
    # A machine of another kind: all its processes would compute as an older processor.
    older = "X86_V3 " + portable_environment()["NPY_DISABLE_CPU_FEATURES"]
    monkeypatch.setitem(SINGLE_THREADED, "NPY_DISABLE_CPU_FEATURES", older)
    with pytest.raises(ConfigError, match="a worker computes differently from the proc"):
        generate(settings, tmp_path / "b", workers=2)
    summary = generate_part(settings, tmp_path / "c", parse_part("0/1"), workers=2, portable=True)
    assert summary.dataset is not None
    assert contents(tmp_path / "c") == contents(tmp_path / "a")


def test_a_machine_that_differs_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = tiny(tmp_path)
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 2)
    generate_part(settings, tmp_path / "out", parse_part("0/2"), workers=1)
    monkeypatch.setattr(arithmetic, "_numpy_arithmetic", lambda: b"another processor")
    with pytest.raises(ConfigError, match=rf"this machine's \({platform.node()}\)"):
        generate_part(settings, tmp_path / "out", parse_part("1/2"), workers=1)
