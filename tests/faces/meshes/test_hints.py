"""Each hint is tried on the mesh that was refused; glsim reads the meshes that it exports."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import GlsimError
from glsim.core.mesh import Mesh
from glsim.faces.meshes.load import load_mesh
from glsim.faces.sources.procedural import ProceduralFaces
from tests.support.people import needs_anny


@cache
def exported(what: str) -> Mesh:
    """Return a mesh that glsim makes: a head with shoulders, one without, or a person."""
    if what == "person":
        from glsim.faces.sources.people import People as Source
    else:
        Source = ProceduralFaces  # noqa: N806
    source = Source(seed=5)
    (face,) = source.load(source.frames(source.subjects(1)[0], 1))
    if what != "head":
        return face.mesh
    kept = face.mesh.faces[face.mesh.vertices_mm[face.mesh.faces, 1].min(axis=1) > -150]
    used = np.unique(kept)
    return Mesh(face.mesh.vertices_mm[used], np.searchsorted(used, kept).astype(np.int32))


def written(path: Path, vertices: NDArray[np.floating], faces: NDArray[np.int32]) -> Path:
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in vertices]
    path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces + 1)]))
    return path


def hints(text: str) -> list[dict[str, str]]:
    """Return the settings that a refusal proposes: each unit, and axes."""
    units = re.findall(r"(?:unit=|set unit to |' or )'([a-z]+|[\d.e+-]+)'", text)
    return [{"unit": unit} for unit in dict.fromkeys(units)] + [
        {"axes": axes} for axes in re.findall(r"axes='([-+xyz]{6})'", text)
    ]


pytestmark = pytest.mark.long
#: What is not mended yet: the face of some busts and people is not found, or found upside down.
OPEN = {
    ("person", 1000, ()), ("person", 1000, ("unit",)), ("bust", 3.1, ()), ("person", 3.1, ()),
    ("bust", 1e-4, ()), ("person", 1e-4, ()), ("person", 25.4, ()),
}  # fmt: skip


@pytest.fixture(autouse=True)
def _not_yet(request: pytest.FixtureRequest) -> None:
    case = request.node.callspec.params
    given = case["given"] if isinstance(case["given"], dict) else {"unit"} if case["given"] else ()
    if (case["what"], case["mm"], tuple(given)) in OPEN:
        request.applymarker(pytest.mark.xfail(reason="a face is not found, or upside down"))


WHAT = ["head", "bust", pytest.param("person", marks=needs_anny)]


@pytest.mark.parametrize("what", WHAT)
@pytest.mark.parametrize(("unit", "mm"), [("mm", 1), ("cm", 10), ("m", 1000)])
@pytest.mark.parametrize("given", [True, False])
def test_what_glsim_exports_it_reads(
    tmp_path: Path, what: str, unit: str, mm: float, given: bool
) -> None:
    mesh = exported(what)
    path = written(tmp_path / "a.obj", mesh.vertices_mm / mm, mesh.faces)
    loaded = load_mesh(path, unit=unit if given else "auto")
    assert loaded.alignment.unit == unit
    used = mesh.vertices_mm[np.unique(mesh.faces)]
    for at in (0, 50, 100):  # the pose stays, and the face is at the origin
        ends = np.percentile(loaded.mesh.vertices_mm, at, axis=0) - np.percentile(used, at, axis=0)
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
    mesh = exported(what)
    path = written(tmp_path / "a.obj", mesh.vertices_mm / mm, mesh.faces)
    try:
        load_mesh(path, **given)
        return
    except GlsimError as error:
        refusal = str(error)
    proposed = hints(refusal)
    assert proposed, refusal
    for change in proposed:
        loaded = load_mesh(path, **(given | change))
        assert loaded.alignment.axes == "+x+y+z", (refusal, change)
        used = mesh.vertices_mm[np.unique(mesh.faces)]
        size = np.ptp(loaded.mesh.vertices_mm, axis=0) / np.ptp(used, axis=0)
        assert 0.7 < size.min() <= size.max() < 1.4, (refusal, change)
