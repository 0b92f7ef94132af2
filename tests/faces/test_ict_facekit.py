"""The ICT-FaceKit source on a small synthetic model (test_ict_facekit_real: on the real one)."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, MeshError
from glsim.faces.face_source import Face, Topology
from glsim.faces.sources.ict_facekit import KNOWN_SHAPES, IctFaceKit, MorphableModel, load_model
from tests.support.face_models import write_face_x_model
from tests.support.face_sets import assert_keys_decide
from tests.support.imports import loaded_after


@pytest.fixture(scope="session")
def small_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_face_x_model(tmp_path_factory.mktemp("ict") / "FaceXModel")


@pytest.fixture(autouse=True)
def _empty_cache(
    tmp_path_factory: pytest.TempPathFactory, small_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each test has a cache of its own; the small model is drawn whole."""
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setattr("glsim.faces.sources.ict_facekit.DRAWN", small_model.parent / "drawn.npz")


def _vertices(face: Face) -> NDArray[np.float32]:
    return face.mesh.vertices_mm


def test_geometry_is_that_of_the_files(small_model: Path) -> None:
    source = IctFaceKit(small_model.parent)  # the folder around FaceXModel will do
    model = load_model(source.root)
    count = len(model.topology.regions)
    assert model.basis.shape == (1 + 100 + len(model.expressions), 3 * count)
    mean = model.basis[0].reshape(-1, 3)
    np.testing.assert_allclose(mean[np.argmax(mean[:, 2])], [0, 0, 45], atol=1e-4)
    corner = mean[model.topology.triangles]
    assert (np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2] > 0).all()
    named = np.array(source.topology.region_names)[model.topology.regions]
    assert mean[named == "forehead", 1].min() > mean[named == "face", 1].max()
    still = model.neutral(np.zeros(100))
    half = 0.5 * (np.array(model.expressions) == "jawOpen")
    opened = model.with_shapes(still, half)
    np.testing.assert_allclose((opened - still)[:, 1].min(), -20, atol=1e-3)  # half of 4 cm


def test_a_face_depends_on_seed_and_key_alone(small_model: Path) -> None:
    source = IctFaceKit(small_model, seed=5)
    keys = [key for subject in source.subjects(3) for key in source.frames(subject, 13)]
    together = assert_keys_decide(source, keys)
    assert_keys_decide(IctFaceKit(small_model, seed=5), keys[3:7], together[3:7])
    assert not np.array_equal(_vertices(together[0]), _vertices(together[13]))
    (other,) = IctFaceKit(small_model, seed=6).load(keys[:1])
    assert isinstance(other, Face)
    assert not np.array_equal(_vertices(together[0]), _vertices(other))


def test_identity_weights_are_standard_normal_within_three(small_model: Path) -> None:
    source = IctFaceKit(small_model)
    weights = np.stack([source.identity(f"i{n:04d}") for n in range(300)])
    assert np.abs(weights).max() <= 3
    assert abs(weights.mean()) * np.sqrt(weights.size) < 4.5
    # A standard normal cut at 3 has variance 0.97334.
    assert weights.var() == pytest.approx(0.97334, abs=4.5 * np.sqrt(2 / weights.size))


def test_action_units_become_shapes() -> None:
    assert {"mouthSmile_L", "jawLeft", "eyeLookOut_R", "browInnerUp_L"} <= KNOWN_SHAPES
    shapes = ("jawOpen", "mouthSmile_L", "mouthSmile_R", "mouthPucker", "mouthFunnel")
    model = MorphableModel(np.zeros((0, 0), np.float32), shapes, Topology(np.zeros((0, 3), int)))
    weights = model.shape_weights({"AU25": 1.0, "AU26": 0.8, "AU12_R": 0.3})
    np.testing.assert_allclose(weights, [0.4, 0, 0.3, 0, 0])  # jaws do not add up
    assert model.shape_weights({"AU25": 1.0})[0] == 0.1
    lips = model.shape_weights({"AU18": 0.5, "AU22": 1.0})
    np.testing.assert_allclose(lips[3:], [1 / 3, 2 / 3])


def test_a_changed_model_is_read_again(tmp_path: Path, small_model: Path) -> None:
    folder = Path(shutil.copytree(small_model, tmp_path / "FaceXModel"))
    one = load_model(folder)
    path = folder / "identity000.obj"
    path.write_text(path.read_text().replace("v -", "v ", 1))
    assert not np.array_equal(load_model(folder).basis[1], one.basis[1])


def test_a_missing_or_broken_model_gives_one_clear_line(tmp_path: Path, small_model: Path) -> None:
    with pytest.raises(ConfigError, match="get the whole face model with 'git clone"):
        IctFaceKit(tmp_path / "nowhere")
    folder = Path(shutil.copytree(small_model, tmp_path / "FaceXModel"))

    def message(error: type[Exception]) -> str:
        with pytest.raises(error) as caught:
            load_model(IctFaceKit(folder).root)
        line = str(caught.value)
        assert str(folder) in line
        return line

    for name in ("identity057.obj", "vertex_indices.json", "generic_neutral_mesh.obj"):
        content = (folder / name).read_bytes()
        (folder / name).unlink()
        assert f"{name}: missing, so this is not a whole" in message(ConfigError)
        (folder / name).write_bytes(content)
    content = (folder / "jawOpen.obj").read_bytes()
    (folder / "jawOpen.obj").unlink()
    assert "jawOpen.obj: missing" in message(ConfigError)
    (folder / "jawOpen.obj").write_bytes(content[: len(content) // 4])
    assert "jawOpen.obj" in message(MeshError)
    (folder / "jawOpen.obj").write_bytes(content.replace(b"v ", b"v nan ", 1))
    assert "jawOpen.obj: a vertex is NaN or infinite" in message(MeshError)
    (folder / "jawOpen.obj").write_bytes(content)
    for text, part in (('{"expressions": ["jawOpen"]}', "no expression browDown_L"), ("{", "")):
        (folder / "vertex_indices.json").write_text(text)
        assert "damaged or of another model (" in (line := message(MeshError))
        assert part in line
    with (folder / "vertex_indices.json").open("wb") as file:
        file.truncate(1 << 40)
    assert "vertex_indices.json: " in message(MeshError)
    shutil.copy(small_model / "vertex_indices.json", folder)
    neutral = folder / "generic_neutral_mesh.obj"
    neutral.write_text(neutral.read_text() + "v 0 0 0\n")
    assert "mesh.obj: damaged or of another model" in message(MeshError)


def test_importing_the_source_is_light() -> None:
    names = "glsim.faces.sources.ict_facekit, glsim.faces.sources.folder, glsim.faces.meshes.load"
    # OpenCV is not among them: the fit of the face needs it, and it loads in 25 ms.
    assert not loaded_after(f"import {names}") & {"trimesh", "moderngl", "scipy"}
