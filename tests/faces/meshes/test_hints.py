"""Each hint is tried on the mesh that was refused; glsim reads the meshes that it exports."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import GlsimError
from glsim.core.mesh import Mesh
from glsim.faces.meshes.load import load_mesh
from glsim.faces.sources.procedural import ProceduralFaces
from tests.support.people import needs_anny

pytestmark = pytest.mark.long
WHAT = ["head", "bust", pytest.param("person", marks=needs_anny)]


@cache
def exported(what: str) -> Mesh:
    """Return a mesh that glsim makes: a head with shoulders, one without, or a person."""
    source: Any = ProceduralFaces(seed=5)
    if what == "person":
        from glsim.faces.sources.people import People

        source = People(seed=5)
    (face,) = source.load(source.frames(source.subjects(1)[0], 1))
    kept = face.mesh.faces
    if what == "head":
        kept = kept[face.mesh.vertices_mm[kept, 1].min(axis=1) > -150]
    used = np.unique(kept)
    return Mesh(face.mesh.vertices_mm[used], np.searchsorted(used, kept).astype(np.int32))


def written(path: Path, what: str, mm: float) -> Path:
    mesh = exported(what)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in mesh.vertices_mm / mm]
    path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in mesh.faces + 1)]))
    return path


@pytest.mark.parametrize("what", WHAT)
@pytest.mark.parametrize(("unit", "mm"), [("mm", 1), ("cm", 10), ("m", 1000)])
@pytest.mark.parametrize("given", [["unit"], []])
def test_what_glsim_exports_it_reads(
    tmp_path: Path, what: str, unit: str, mm: float, given: list[str]
) -> None:
    loaded = load_mesh(written(tmp_path / "a.obj", what, mm), unit=unit if given else "auto")
    assert loaded.alignment.unit == unit
    for at in (0, 50, 100):  # the pose stays, and the face is at the origin
        meshes = loaded.mesh, exported(what)
        ends = np.subtract(*(np.percentile(m.vertices_mm, at, axis=0) for m in meshes))
        assert np.abs(ends).max() < 40


@pytest.mark.parametrize("what", WHAT)
@pytest.mark.parametrize(
    ("mm", "given"),
    [(10, {"unit": "mm"}), (10, {"unit": "m"}), (1, {"unit": "cm"}), (1000, {"unit": "inch"}),
     (65, {}), (3.1, {}), (1e-4, {}), (25.4, {})],
    ids=str,
)  # fmt: skip
def test_a_hint_helps_the_mesh_that_was_refused(
    tmp_path: Path, what: str, mm: float, given: dict[str, str]
) -> None:
    path = written(tmp_path / "a.obj", what, mm)
    try:
        load_mesh(path, **given)
        return
    except GlsimError as error:
        refusal = str(error)
    units = re.findall(r"unit='([a-z]+|[\d.e+-]+)'", refusal)
    hints = [{"unit": unit} for unit in dict.fromkeys(units)]
    hints += [{"axes": axes} for axes in re.findall(r"axes='([-+xyz]{6})'", refusal)]
    assert hints, refusal
    for change in hints:
        loaded = load_mesh(path, **(given | change))
        assert loaded.alignment.axes == "+x+y+z", (refusal, change)
        size = np.ptp(loaded.mesh.vertices_mm, axis=0) / np.ptp(exported(what).vertices_mm, axis=0)
        assert 0.7 < size.min() <= size.max() < 1.4, (refusal, change)


@pytest.mark.parametrize("what", ["head", "wall"])
@pytest.mark.parametrize("words", ["render a.obj", "generate -o d --source folder --root ."])
def test_a_command_names_the_options_that_work_in_it(
    here: Path, capsys: pytest.CaptureFixture[str], words: str, what: str
) -> None:
    path = written(here / "a.obj", "head", 3.1)
    if what == "wall":
        path.write_text("v 0 0 0\nv 200 0 0\nv 0 200 0\nv 200 200 1\nf 1 2 3\nf 2 4 3\n")
    assert main(words.split()) == 1
    (hint, *_) = re.findall(r"--(?:set source\.)?(?:unit|axes)=[\w.+]+", capsys.readouterr().err)
    assert main([*words.split(), *hint.split()]) == 0
