"""The shell blocks of pages run as they stand, from the text itself, in one folder per page.

Commands that make much are made small by options behind theirs (the last one counts); the tuner,
which serves until it is ended, and downloads print their help instead.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from glsim.faces.people.files import FETCH, has_people
from glsim.files.png import encode_png
from tests.support.imports import ROOT
from tests.support.recordings import scene, write_static_pair
from tests.support.scenes import face_mesh

pytestmark = pytest.mark.long

#: Stands for the command glsim: makes data sets and trainings small.
_SMALL = """#!/bin/sh
run() { exec PYTHON -m glsim "$@"; }
case "$1" in
    generate) case "$*" in
        *--preset\\ office*) run "$@" --subjects 1 --frames-per-subject 1 --workers 1 -q ;;
        *) run "$@" --subjects 10 --frames-per-subject 1 --workers 2 -q ;;
        esac ;;
    train) run "$@" --steps 1 --set training.batch=2 --set data.validation_frames=1 ;;
    tune|fetch) run "$1" --help ;;
    *) run "$@" ;;
esac
"""
#: Blocks that set up a machine or a checkout.
_SET_UP = re.compile(r"apt-get|make demo|pip install|docker |apptainer ")

PAGES = ["README.md", "docs/start.md", "docs/howto/noise_stage.md"]


def blocks(page: str) -> list[str]:
    """The shell blocks of a page that use glsim."""
    found = re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    plain = [re.sub(r"\s#.*", "", block) for block in found]  # comments name extras
    return [block for block in plain if "glsim " in block and not _SET_UP.search(block)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What the pages take for granted: a mesh, a clean map, a noisy one, a recording, a stage."""
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "glsim"
    command.write_text(_SMALL.replace("PYTHON", sys.executable))
    command.chmod(0o755)
    work = tmp_path / "work"
    work.mkdir()
    mesh = face_mesh()
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices_mm]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    (work / "face.obj").write_text("\n".join(lines))
    flat = np.full((424, 512), 900, np.uint16)
    for name in ("clean.png", "noisy.png"):
        (work / name).write_bytes(encode_png(flat))
    write_static_pair(work / "recording", scene(), 1.6)
    page = (ROOT / "docs/howto/noise_stage.md").read_text(encoding="utf-8")
    (work / "ripple.glsl").write_text(re.findall(r"```glsl\n(.*?)```", page, re.DOTALL)[0])
    return tmp_path


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(folder: Path, page: str) -> None:
    script = "\n".join(["set -e", *blocks(page)])
    if not has_people():
        script = "\n".join(line for line in script.splitlines() if "--preset office" not in line)
    assert script.count("glsim ") >= 4, FETCH
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
