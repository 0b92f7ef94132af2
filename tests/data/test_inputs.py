"""Test that a resumed data set does not mix two versions of its inputs."""

import os
import shutil
from pathlib import Path

import pytest

from glsim.core.errors import ConfigError, DatasetError, GlsimError
from glsim.core.files.contents import content_hash
from glsim.data import arithmetic, chunks
from glsim.data.driver import generate
from glsim.data.progress import FrameProgress
from glsim.settings.schema import Settings, load_settings
from tests.support.dataset_fakes import TINY_SENSOR, contents
from tests.support.face_sets import FACE, TRIANGLES, obj_bytes, put

STAGE = """#version 330 core
// lift: moves depth.
#include "amount.glsl"
uniform sampler2D u_depth;
out float depth;
void main() { depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r + AMOUNT_M; }
"""
PYTHON = """
from glsim.noise.stage import array_stage

@array_stage()
def lift(view, layers, p):
    \"\"\"Moves depth.\"\"\"
    return {"depth": layers["depth"] + 0.01}
"""


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(chunks.CHUNK_FRAMES, "png", 2)


def with_stage(folder: Path, use: str) -> Settings:
    (folder / "lift.glsl").write_text(STAGE)
    (folder / "amount.glsl").write_text("#define AMOUNT_M 0.01\n")
    (folder / "lift.py").write_text(PYTHON)
    (folder / "mine.toml").write_text(f'{TINY_SENSOR}\n[[stage]]\nuse = "{use}"\n')
    source = {"kind": "procedural", "subjects": 2, "frames_per_subject": 3}
    return load_settings(overrides={"sensor": str(folder / "mine.toml"), "source": source})


def stop(state: FrameProgress) -> None:
    if state.done >= 3:
        raise KeyboardInterrupt


def begin(settings: Settings, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the first chunks of a data set."""
    monkeypatch.setattr("glsim.data.progress._PROGRESS_EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        generate(settings, out, workers=1, progress=stop)
    assert list((out / ".glsim" / "chunks").iterdir())


@pytest.mark.parametrize(
    ("use", "file", "text"),
    [
        ("lift.glsl", "lift.glsl", STAGE.replace("+ AMOUNT_M", "+ 0.05")),
        ("lift.glsl", "amount.glsl", "#define AMOUNT_M 0.05\n"),
        ("lift.py:lift", "lift.py", PYTHON.replace("0.01", "0.05")),
    ],
)
def test_an_edited_stage_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, use: str, file: str, text: str
) -> None:
    settings = with_stage(tmp_path, use)
    begin(settings, tmp_path / "out", monkeypatch)
    before = (tmp_path / file).read_text()
    (tmp_path / file).write_text(text)
    with pytest.raises(ConfigError, match=rf"stage file \S*{file} was changed since .*out was beg"):
        generate(settings, tmp_path / "out", workers=1)
    (tmp_path / file).write_text(before)
    generate(settings, tmp_path / "out", workers=1)
    generate(settings, tmp_path / "whole", workers=1)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_a_run_that_failed_before_its_first_frame_leaves_the_folder_free(tmp_path: Path) -> None:
    settings = with_stage(tmp_path, "lift.glsl")
    (tmp_path / "amount.glsl").write_text("#define AMOUNT_M no_such_name\n")
    with pytest.raises(GlsimError, match="no_such_name"):
        generate(settings, tmp_path / "out", workers=1)
    (tmp_path / "amount.glsl").write_text("#define AMOUNT_M 0.01\n")
    generate(settings, tmp_path / "out", workers=1)
    generate(settings, tmp_path / "whole", workers=1)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_a_complete_set_is_refused_too_and_without_its_state(tmp_path: Path) -> None:
    settings = with_stage(tmp_path, "lift.glsl")
    generate(settings, tmp_path / "out", workers=1)
    shutil.rmtree(tmp_path / "out" / ".glsim")
    (tmp_path / "amount.glsl").write_text("#define AMOUNT_M 0.05\n")
    with pytest.raises(ConfigError, match=r"stage file \S*amount.glsl was changed"):
        generate(settings, tmp_path / "out", workers=1)


def scans(folder: Path) -> Settings:
    for number in range(3):
        put(folder / "scans" / "a" / f"{number}.obj", obj_bytes(FACE + number, TRIANGLES))
    put(folder / "scans" / "a" / "skin.mtl", b"newmtl a\nKd 1 1 1\n")
    (folder / "mine.toml").write_text(TINY_SENSOR)
    return load_settings(
        overrides={
            "sensor": str(folder / "mine.toml"),
            "source": {"kind": "folder", "root": str(folder / "scans")},
        }
    )


def test_a_swapped_mesh_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = scans(tmp_path)
    begin(settings, tmp_path / "out", monkeypatch)
    put(tmp_path / "scans" / "a" / "skin.mtl", b"newmtl a\nKd 0 1 1\n")
    with pytest.raises(ConfigError, match=r"a file of source 0 folder was changed since"):
        generate(settings, tmp_path / "out", workers=1)


@pytest.mark.long
def test_a_mesh_swapped_during_the_run_is_noticed(tmp_path: Path) -> None:
    settings = scans(tmp_path)
    whole = tmp_path / "whole"
    generate(settings, whole, workers=1)
    before = (tmp_path / "scans" / "a" / "2.obj").read_bytes()

    def swap(_: FrameProgress) -> None:
        put(tmp_path / "scans" / "a" / "2.obj", obj_bytes(FACE * 1.1, TRIANGLES))

    with pytest.raises(DatasetError, match=r"source 0 folder: a/2.obj was changed during the run"):
        generate(settings, tmp_path / "out", workers=1, progress=swap)
    put(tmp_path / "scans" / "a" / "2.obj", before)
    generate(settings, tmp_path / "out", workers=1)
    assert contents(tmp_path / "out") == contents(whole)


def test_a_file_of_the_same_size_and_another_time_is_hashed_again(tmp_path: Path) -> None:
    file = put(tmp_path / "a", b"one")
    first = content_hash(file)
    assert content_hash(file) == first
    put(file, b"two")
    os.utime(file, ns=(1, 1))
    assert content_hash(file) != first
    os.mkfifo(tmp_path / "pipe")
    assert content_hash(tmp_path / "pipe") == "no regular file"
    assert content_hash(tmp_path / "none").startswith("unreadable: No such file")
    (tmp_path / "huge").touch()
    os.truncate(tmp_path / "huge", 20_000_000_000)
    assert content_hash(tmp_path / "huge") == "20000000000 bytes", "not read"


def test_other_occluders_are_another_arithmetic(monkeypatch: pytest.MonkeyPatch) -> None:
    """A data set records which triangles the library keeps: another version may keep others."""
    compute = arithmetic._numpy_arithmetic.__wrapped__
    before = compute()
    assert compute() == before
    monkeypatch.setattr(arithmetic, "occluder_of", lambda vertices, faces: faces[::2])
    assert compute() != before
