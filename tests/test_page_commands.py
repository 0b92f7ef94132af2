"""The shell blocks of pages run as they stand, from the text itself, in one folder per page.

``tests/support/page_command.py`` stands for the command glsim.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.files.png import encode_png
from glsim.data.map_files import encode_map
from glsim.faces.people.fetch import FETCH
from tests.support import page_command
from tests.support.eval_scenes import write_pairs
from tests.support.imports import ROOT
from tests.support.people import has_people
from tests.support.recordings import scene, write_static_pair
from tests.support.scenes import face_mesh

#: Blocks that set up a machine or a checkout, or are a job of a cluster.
_SET_UP = re.compile(r"apt-get|make demo|pip install|docker |apptainer |srun ")
#: A denoiser of one's own, as docs/evaluation.md has it.
_OWN = "def my_function(noisy_mm, valid):\n    return noisy_mm, valid\n"


def blocks(page: str) -> list[str]:
    """The shell blocks of a page that use glsim."""
    found = re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    plain = [re.sub(r"\s#.*", "", block) for block in found]  # comments name extras
    return [block for block in plain if "glsim " in block and not _SET_UP.search(block)]


PAGES = [
    page
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if not {"_build", "generated"} & {*path.parts}
    and blocks(page := path.relative_to(ROOT).as_posix())
]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data set that pages take for granted."""
    folder = tmp_path_factory.mktemp("made") / "data"
    size = ["--subjects", "10", "--frames-per-subject", "1", "--workers", "1"]
    layers = ["--set", "output.crop=96", "--set", "output.layers=clean,expected,noisy"]
    assert main(["generate", "-o", str(folder), *size, *layers, "-q"]) == 0
    return folder


@pytest.fixture
def folder(tmp_path: Path, data: Path) -> Path:
    """What pages take for granted: a mesh, maps, recordings, a data set, pairs, a stage."""
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "glsim"
    script = page_command.__file__
    command.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} {script} "$@"\n')
    command.chmod(0o755)
    work = tmp_path / "work"
    work.mkdir()
    shutil.copytree(data, work / "data")
    mesh = face_mesh()
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices_mm]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    (work / "face.obj").write_text("\n".join(lines))
    flat = np.full((424, 512), 900, np.uint16)
    for name in ("clean.png", "noisy.png", "infrared.png"):
        (work / name).write_bytes(encode_png(flat))
    np.save(work / "noisy.npy", flat)
    depth_m = np.asarray(flat / 1000, np.float32)
    (work / "clean.exr").write_bytes(encode_map(depth_m, "exr", 1.0))
    for name in ("recording", "walls"):
        write_static_pair(work / name, scene(), 1.6)
    write_pairs(work / "pairs", 2)
    (work / "my_module.py").write_text(_OWN)
    page = (ROOT / "docs/howto/noise_stage.md").read_text(encoding="utf-8")
    (work / "burst.glsl").write_text(re.findall(r"```glsl\n(.*?)```", page, re.DOTALL)[0])
    return tmp_path


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(folder: Path, page: str) -> None:
    script = "\n".join(["set -e", *blocks(page)])
    if not has_people():
        script = "\n".join(line for line in script.splitlines() if "--preset office" not in line)
    if find_spec("OpenEXR") is None:
        script = "\n".join(line for line in script.splitlines() if ".exr" not in line)
    assert "glsim " in script, FETCH
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=folder / "work",
        env=os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "Traceback" not in done.stderr


def test_a_wrong_line_that_is_only_read_is_noticed(folder: Path) -> None:
    for line in ("glsim paper tabels data", "glsim tune kinect-v2 --prot 80", "glsim fetch"):
        done = subprocess.run(
            ["bash", "-c", line],
            env=os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"},
            capture_output=True, check=False, cwd=folder / "work",
        )  # fmt: skip
        assert done.returncode != 0, line
