"""Biwi: people, posed templates, depth, poses, calibrations, damaged files."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as quick
from hypothesis import strategies as st

from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError, MeshError
from glsim.faces.face_source import BadFace, Face
from glsim.faces.scans.biwi_files import read_calibration, read_depth_bin
from glsim.faces.sources.biwi import PEOPLE, Biwi
from tests.support.face_sets import (
    CALIBRATION,
    FACE,
    OTHERS,
    all_keys,
    depth_bytes,
    needs_others,
    pose_text,
    put,
    write_recording,
)


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
    with pytest.raises(ConfigError, match="has 3 subjects, 4 were asked for"):
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


@quick(deadline=None, max_examples=60)
@given(st.integers(1, 9), st.integers(1, 7), st.randoms(use_true_random=False))
def test_depth_round_trip(
    tmp_path_factory: pytest.TempPathFactory, width: int, height: int, random: object
) -> None:
    rng = np.random.default_rng(random.randrange(1000))  # type: ignore[attr-defined]
    depth = rng.integers(1, 5000, (height, width)).astype(np.uint16)
    depth[rng.random((height, width)) < 0.5] = 0
    path = tmp_path_factory.mktemp("d") / "frame_depth.bin"
    path.write_bytes(depth_bytes(depth))
    np.testing.assert_array_equal(read_depth_bin(path), depth)


def _words(*words: int) -> bytes:
    return np.array(words, "<i4").tobytes()


@pytest.mark.parametrize(
    "data",
    [
        b"123",
        _words(2**31 - 1, 2**31 - 1),
        _words(0, 5),
        _words(2, 2, -1, 5),
        _words(2, 2, 0, 0),
        _words(2, 2, 3, 2),
        _words(2, 2, 0, 4),
        _words(2, 2, 2, 0),
        _words(2, 2, 4, 0, 7),
        _words(2, 2, 2, 2, -5),
    ],
)
def test_damaged_depth_is_named(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(MeshError, match=r"frame_depth\.bin: cannot be used"):
        read_depth_bin(put(tmp_path / "frame_depth.bin", data))


def test_calibration(tmp_path: Path) -> None:
    path = put(tmp_path / "depth.cal", CALIBRATION)
    assert read_calibration(path) == Intrinsics(640, 480, 575.816, 575.816, 320.5, 240.5)
    with pytest.raises(MeshError, match="26 numbers, not 27"):
        read_calibration(put(path, CALIBRATION.replace(b"640 ", b"")))
    with pytest.raises(MeshError, match="no plain pinhole"):
        read_calibration(put(path, CALIBRATION.replace(b"0 0 0 0", b"1 0 0 0")))


@needs_others
def test_a_whole_tree() -> None:
    root = OTHERS / "hpdb"
    source = Biwi(root)
    (face,) = source.load(all_keys(source))
    assert isinstance(face, Face)
    assert face.key.subject == "F01"
    depth = read_depth_bin(source.depth_path(face.key))
    assert depth.shape == (480, 640)
    assert (depth > 0).any()
    assert read_calibration(root / "01" / "rgb.cal").fx == 517.679
