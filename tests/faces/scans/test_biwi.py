"""Biwi: people, posed templates, poses, damaged files."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.faces.face_source import BadFace, Face
from glsim.faces.sources.biwi import PEOPLE, Biwi
from tests.support.face_sets import FACE, all_keys, pose_text, put, write_recording


def test_people_not_recordings(tmp_path: Path) -> None:
    for number in (3, 15, 1, 22):
        write_recording(tmp_path / "hpdb", number)
    source = Biwi(tmp_path)
    assert source.subjects(None) == ["F01", "F03", "M01"]
    keys = source.frames("F03", None)
    assert [(k.sequence, k.frame) for k in keys] == [
        ("03", 3), ("03", 4), ("03", 5), ("15", 3), ("15", 4), ("15", 5)
    ]  # fmt: skip
    assert keys[1].time_s == pytest.approx(1 / 30)
    assert [k.frame for k in Biwi(tmp_path, every=2).frames("F01", None)] == [3, 5]
    assert len(set(PEOPLE)) == 20
    assert len(PEOPLE) == 24
    with pytest.raises(ConfigError, match="has 3 subjects, 4 asked for"):
        source.subjects(4)
    with pytest.raises(ConfigError, match="no subject 'F02'"):
        source.frames("F02", None)
    with pytest.raises(ConfigError, match="no recording NN"):
        Biwi(tmp_path / "hpdb" / "01").subjects(None)


def test_templates_are_turned_as_recorded(tmp_path: Path) -> None:
    source = pickle.loads(pickle.dumps(Biwi(write_recording(tmp_path))))
    faces = list(source.load(all_keys(source)))
    assert all(isinstance(face, Face) for face in faces)
    first, second = faces[0].mesh, faces[1].mesh
    assert first.faces is second.faces
    still = FACE - FACE.mean(axis=0)
    np.testing.assert_allclose(first.vertices_mm - first.vertices_mm.mean(axis=0), still, atol=1e-3)
    # A turn about the camera's y (down) by +10 degrees: R x has its z lowered by sin(10) x.
    nose = np.argmax(first.vertices_mm[:, 2])
    turn = np.array([[np.cos(np.radians(10)), 0, -np.sin(np.radians(10))], [0, 1, 0],
                     [np.sin(np.radians(10)), 0, np.cos(np.radians(10))]])  # fmt: skip
    np.testing.assert_allclose(second.vertices_mm, first.vertices_mm @ turn.T, atol=1e-3)
    assert second.vertices_mm[nose, 0] < 0
    assert faces[0].notes["head_centre_mm"] == [30.0, -20.0, 900.0]
    placed = source.in_camera(all_keys(source)[0]).vertices_mm
    np.testing.assert_allclose(
        placed * [1, -1, -1], (FACE - [3, 12, 0]) * [1, -1, -1] + [30, -20, 900], atol=1e-2
    )


def test_faces_that_look_away_or_are_damaged_are_skipped(tmp_path: Path) -> None:
    write_recording(tmp_path, 1, frames=2)
    away = np.diag([-1.0, 1.0, -1.0])
    put(tmp_path / "01/frame_00009_pose.txt", pose_text(away, (0, 0, 900)))
    put(tmp_path / "02/frame_00003_pose.txt", pose_text(np.eye(3), (0, 0, 900)))
    source = Biwi(tmp_path)
    results = list(source.load(all_keys(source)))
    assert [isinstance(result, Face) for result in results] == [True, True, False, False]
    reasons = [str(result.error) for result in results if isinstance(result, BadFace)]
    assert "looks away" in reasons[0]
    assert "02.obj: cannot be read" in reasons[1]
