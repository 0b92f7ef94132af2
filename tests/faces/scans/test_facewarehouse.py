"""FaceWarehouse: 47 shapes, poses, scale from the face, interpolation, damaged files."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import ConfigError, MeshError
from glsim.faces.sources.facewarehouse import (
    FACE_WIDTH_MM,
    FaceWarehouse,
    mm_per_unit,
    read_blend_shapes,
)
from tests.support.face_sets import (
    FACE,
    all_keys,
    blend_shapes,
    good_faces,
    obj_bytes,
    put,
    quads,
    shape_bytes,
    write_tester,
)


def test_all_47_shapes_and_the_poses(tmp_path: Path) -> None:
    write_tester(tmp_path / "FaceWarehouse_Data_0", 2)
    write_tester(tmp_path / "FaceWarehouse_Data_0", 10)
    source = FaceWarehouse(tmp_path)
    assert source.subjects(None) == ["Tester_2", "Tester_10"]
    keys = all_keys(source)
    assert [(k.sequence, k.frame) for k in keys[:50]] == [
        *(("shapes", n) for n in range(47)), *(("poses", n) for n in range(3))
    ]  # fmt: skip
    faces = good_faces(pickle.loads(pickle.dumps(source)), keys)
    assert len({id(face.mesh.faces) for face in faces}) == 1
    assert faces[46].expression == {"shape_46": 1.0}
    assert faces[0].expression == {}
    scale = FACE_WIDTH_MM / np.ptp(FACE[:, 0])  # the analytic face ends at its cheeks
    moved = faces[46].mesh.vertices_mm - faces[0].mesh.vertices_mm
    wanted = (blend_shapes(1.0)[46] - blend_shapes(1.0)[0]) * scale
    np.testing.assert_allclose(moved, wanted, atol=0.01)
    np.testing.assert_allclose(faces[49].mesh.vertices_mm, faces[20].mesh.vertices_mm, atol=0.01)
    assert faces[0].notes["scale"] == "from the width of the neutral face"
    assert len(all_keys(FaceWarehouse(tmp_path, poses=False))) == 94


def test_steps_between_the_shapes(tmp_path: Path) -> None:
    write_tester(tmp_path, poses=0)
    source = FaceWarehouse(tmp_path, steps=4, unit="110")
    keys = source.frames("Tester_1", None)
    assert len(keys) == 46 * 4 + 1
    assert keys[4].time_s == pytest.approx(4 / 30)
    faces = good_faces(source, [keys[0], keys[2], keys[4], keys[-1]])
    assert faces[1].expression == {"shape_1": pytest.approx(0.5)}
    halfway = (faces[0].mesh.vertices_mm + faces[2].mesh.vertices_mm) / 2
    np.testing.assert_allclose(faces[1].mesh.vertices_mm, halfway, atol=1e-3)
    assert faces[3].expression == {"shape_46": 1.0}
    assert "scale" not in faces[0].notes


def test_obj_shapes_do_where_there_is_no_bs(tmp_path: Path) -> None:
    shapes = blend_shapes()
    for number in (0, 1, 46):
        data = obj_bytes(shapes[number], quads(), "/1/1")
        put(tmp_path / f"Tester_1/Blendshape/shape_{number}.obj", data)
    source = FaceWarehouse(tmp_path, steps=2)
    assert [key.frame for key in all_keys(source)] == [0, 1, 2, 92]
    faces = good_faces(source, all_keys(source))
    assert faces[1].expression == {"shape_1": pytest.approx(0.5)}


def test_another_person_tells_the_topology(tmp_path: Path) -> None:
    folder = write_tester(tmp_path, 1, poses=0)
    write_tester(tmp_path, 2, poses=0)
    (folder / "Blendshape/shape_0.obj").unlink()
    source = FaceWarehouse(tmp_path)
    assert len(good_faces(source, source.frames("Tester_1", 2))) == 2


def test_the_scale_is_that_of_the_face_and_not_of_the_ears() -> None:
    ears = FACE[np.abs(FACE[:, 0] - 3) > 65] * [1.3, 1, 1] - [0, 0, 90]
    head = np.concatenate([FACE, ears])
    assert mm_per_unit(head / 7) == pytest.approx(mm_per_unit(FACE / 7), rel=0.02)
    assert mm_per_unit(np.zeros((4, 3))) == 0


@pytest.mark.parametrize(
    "data",
    [
        b"12345",
        shape_bytes(blend_shapes()[:46], 46),
        shape_bytes(blend_shapes(), 45),
        shape_bytes(blend_shapes())[:-1],
        np.array([46, 2**31 - 1, 1], "<i4").tobytes(),
        np.array([46, -5, 1], "<i4").tobytes(),
    ],
)
def test_damaged_shape_files_are_named(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(MeshError, match=r"shape\.bs: cannot be used"):
        read_blend_shapes(put(tmp_path / "shape.bs", data), [0])


def test_a_header_that_counts_the_neutral_is_fine(tmp_path: Path) -> None:
    path = put(tmp_path / "shape.bs", shape_bytes(blend_shapes(), 47))
    assert read_blend_shapes(path, [46])[0].shape == (775, 3)


def test_a_person_without_neutral_or_of_absurd_scale_is_skipped(tmp_path: Path) -> None:
    data = obj_bytes(blend_shapes(0.5)[0], quads())
    put(tmp_path / "Tester_1/TrainingPose/pose_0.obj", data)
    put(tmp_path / "Tester_2/TrainingPose/pose_4.obj", data)
    source = FaceWarehouse(tmp_path)
    first, second = source.load(all_keys(source))
    assert "give it, such as unit=cm" in str(first.error)
    assert "has no neutral face" in str(second.error)


def test_wrong_roots(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no folder Tester_N"):
        FaceWarehouse(tmp_path).subjects(None)
    write_tester(tmp_path)
    with pytest.raises(ConfigError, match="has 1 subject, 2 asked"):
        FaceWarehouse(tmp_path).subjects(2)
    with pytest.raises(ConfigError, match=r"no subject 'Tester_2' \(did you mean 'Tester_1'"):
        FaceWarehouse(tmp_path).frames("Tester_2", None)
