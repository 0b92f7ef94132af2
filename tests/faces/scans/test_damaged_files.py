"""Damaged files of face sets are read or skipped with a reason; meshes: see test_load."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as quick
from hypothesis import strategies as st

from glsim.faces.face_source import BadFace, Face, FaceSource
from glsim.faces.sources.biwi import Biwi
from glsim.faces.sources.facewarehouse import FaceWarehouse
from tests.support.face_sets import all_keys, write_recording, write_tester

_SOURCES: dict[str, tuple[Callable[[Path], FaceSource], str]] = {
    "shape.bs": (FaceWarehouse, "Tester_1/Blendshape/shape.bs"),
    "pose.txt": (Biwi, "01/frame_00004_pose.txt"),
}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of each kind."""
    root = tmp_path_factory.mktemp("damage")
    write_tester(root / "shape.bs", 1, poses=0)
    write_recording(root / "pose.txt", 1, frames=2)
    return root


def read(root: Path, name: str) -> None:
    """Read a file of a set by its source; a BadFace is fine."""
    open_source, path = _SOURCES[name]
    source = open_source(root / name)
    keys = [key for key in all_keys(source) if key.path == path] or all_keys(source)
    for face in source.load(keys[:1] + keys[-1:]):
        if isinstance(face, BadFace):
            assert "\n" not in str(face.error)
        else:
            assert isinstance(face, Face)
            assert np.isfinite(face.mesh.vertices_mm).all()
            assert face.mesh.faces.max() < len(face.mesh.vertices_mm)


@pytest.mark.parametrize("name", list(_SOURCES))
@quick(
    max_examples=25,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(at=st.floats(0, 1), length=st.integers(0, 40), new=st.binary(max_size=12))
@pytest.mark.long
def test_damage_anywhere_does_no_harm(
    tree: Path, name: str, at: float, length: int, new: bytes
) -> None:
    path = tree / name / _SOURCES[name][1]
    whole = path.read_bytes()
    start = int(at * len(whole))
    path.write_bytes(whole[:start] + new + whole[start + length :] * (length < 40))
    try:
        read(tree, name)
    finally:
        path.write_bytes(whole)
