"""Face regions: one table of names, a number per pixel as in the mesh, and back from disk."""

import json
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.mesh import Mesh
from glsim.data.reader import Dataset, open_dataset
from glsim.data.verification import verify
from glsim.faces.face_source import FaceSource, Topology
from glsim.faces.one_mesh import OneMesh
from glsim.faces.people.model import REGIONS as PEOPLE_REGIONS
from glsim.faces.procedural.model import REGIONS
from glsim.faces.regions import KNOWN_REGIONS, region_numbers
from glsim.faces.sources.ict_facekit import REGIONS as ICT_REGIONS
from glsim.faces.sources.procedural import ProceduralFaces
from glsim.looks.dress import WORN_REGIONS
from glsim.looks.room.scenery import ROOM_REGIONS
from glsim.render.region_pass import majority_last
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from tests.support.dataset_fakes import contents
from tests.support.face_models import Board, write_simulated
from tests.support.scenes import only_frame

ALL = ("clean", "noisy", "regions")


def settings(**more: object) -> Settings:
    output = {"crop": 64, "layers": list(ALL)}
    return load_settings(
        overrides={"sensor": "ideal", "output": output} | more,
        source={"subjects": 1, "frames_per_subject": 1},
    )


def frame(context: Context, source: object, **more: object) -> Frame:
    return only_frame(simulate(settings(**more), sources=[source], context=context, layers=ALL))  # type: ignore[list-item]


def test_names_have_one_number_in_every_data_set() -> None:
    sources = {*REGIONS, *ICT_REGIONS, *PEOPLE_REGIONS}
    assert sources | set(ROOM_REGIONS) | set(WORN_REGIONS) == set(KNOWN_REGIONS)
    assert region_numbers([ProceduralFaces()])["nose"] == KNOWN_REGIONS.index("nose") + 1
    mixed = region_numbers([Board(), ProceduralFaces()])
    assert mixed["nose"] == KNOWN_REGIONS.index("nose") + 1
    assert mixed["tail"] == len(KNOWN_REGIONS) + 1
    assert list(mixed.values()) == sorted(mixed.values())
    mesh = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(ConfigError, match="leave regions out of"):
        region_numbers([OneMesh(mesh)])


def test_each_side_of_a_board_has_its_own_number(context: Context) -> None:
    found = frame(context, Board(), scene={"wall_mm": 1200})
    tail, nose, wall = (found.region_numbers[name] for name in ("tail", "nose", "wall"))
    near = (found.clean_m > 0) & (found.clean_m < 1)
    codes = found.region_codes
    assert set(np.unique(codes)) == {wall, tail, nose}
    np.testing.assert_array_equal(codes != wall, near)
    middle = 32 - found.window.left
    assert (codes[:, : middle - 1][near[:, : middle - 1]] == nose).all()
    assert (codes[:, middle + 1 :][near[:, middle + 1 :]] == tail).all()
    assert found.seen_regions == {"nose": nose, "tail": tail, "wall": wall}


@pytest.mark.parametrize(
    ("sensor", "rig"),
    [("ideal", {}), ("ideal", {"supersample": 3}), ("kinect-v2-fankhauser", {"deliver": "raw"})],
)
def test_what_has_depth_has_a_region(context: Context, sensor: str, rig: dict[str, object]) -> None:
    found = frame(context, ProceduralFaces(2), sensor=sensor, rig=rig, pose={"yaw_deg": 15})
    codes, clean = found.regions, found.clean
    assert ((codes > 0) == (clean > 0)).mean() > 0.999
    nose = codes == found.region_numbers["nose"]
    assert nose.sum() > 100
    nearest = np.unravel_index(np.argmin(np.where(clean > 0, clean, 65535)), clean.shape)
    assert nose[nearest], "the tip of the nose is the nose"


def test_the_label_of_a_triangle_is_that_of_most_corners() -> None:
    faces = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 3], [3, 0, 2]], np.int32)
    labels = np.array([4, 4, 7, 5], np.float32)
    turned = majority_last(faces, labels)
    assert labels[turned[:, 2]].tolist() == [4, 4, 4, 4, 4]
    for before, after in zip(faces.tolist(), turned.tolist(), strict=True):
        assert after in [before[k:] + before[:k] for k in range(3)], "the winding stays"


def test_regions_cost_nothing_unless_asked_for(context: Context) -> None:
    class NoLabels(ProceduralFaces):
        @property
        def topology(self) -> Topology:
            raise AssertionError("nobody asked")

    with_them = frame(context, ProceduralFaces())
    (without,) = simulate(settings(), sources=[NoLabels()], context=context)
    np.testing.assert_array_equal(without.clean, with_them.clean)
    np.testing.assert_array_equal(without.noisy, with_them.noisy)
    with pytest.raises(ConfigError, match="without the layer 'regions'"):
        _ = without.regions


def test_a_mesh_of_another_size_is_skipped(context: Context) -> None:
    (found,) = simulate(settings(), sources=[Board(wrong=True)], context=context, layers=ALL)
    assert not isinstance(found, Frame)
    assert "8 vertices, the regions of its source are for 4" in found.why


def write(out: Path, form: str, workers: int) -> Dataset:
    sources: list[FaceSource] = [Board(), ProceduralFaces()]
    given = load_settings(
        overrides={
            "sensor": "ideal",
            "source": [{"subjects": 1, "frames_per_subject": 2}, {"subjects": 1, "count": 2}],
            "output": {"crop": 48, "format": form, "layers": list(ALL)},
            "split": [1, 0, 0],
        }
    )
    write_simulated(out, given, sources, workers)
    return open_dataset(out)


@pytest.mark.parametrize("form", ["png", "webdataset"])
def test_a_mixed_data_set_has_one_table_and_survives_damage(tmp_path: Path, form: str) -> None:
    dataset = write(tmp_path / "one", form, 1)
    assert dataset.layers == ALL
    numbers = dataset.regions
    assert numbers == region_numbers([Board(), ProceduralFaces()])
    seen: dict[str, set[str]] = {}
    for pair in dataset:
        values = set(np.unique(pair.regions).tolist()) - {0}
        assert pair.regions.dtype == np.uint8
        assert values == set(pair.record["regions"].values())
        assert pair.record["regions"].items() <= numbers.items()
        seen.setdefault(pair.record["source"], set()).update(pair.record["regions"])
    assert seen["board"] == {"nose", "tail"}
    assert {"nose", "lips", "cheek"} <= seen["procedural"]
    assert verify(tmp_path / "one", deep=True) == []

    record = dataset.frames()[0].record["files"]["regions"]
    file = tmp_path / "one" / record["name"]
    data = bytearray(file.read_bytes())
    data[record.get("offset", 0) + 60] ^= 255
    file.write_bytes(data)
    assert any(file.name in problem for problem in verify(tmp_path / "one", deep=True))
    with pytest.raises(DatasetError):
        _ = open_dataset(tmp_path / "one").frames()[0].regions
    write(tmp_path / "one", form, 1)  # the same command repairs it
    write(tmp_path / "two", form, 1)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    if form == "png":
        row = json.loads((tmp_path / "one/train/metadata.jsonl").read_text().splitlines()[0])
        assert row["regions_file_name"].endswith("_regions.png")


def test_a_set_without_regions_says_so(tmp_path: Path) -> None:
    given = settings(output={"crop": 48, "layers": ["clean", "noisy"]}, split=[1, 0, 0])
    write_simulated(tmp_path, given, [Board()])
    dataset = open_dataset(tmp_path)
    assert dataset.regions == {}
    assert "regions" not in dataset.header
    with pytest.raises(DatasetError, match="has no layer 'regions'"):
        _ = dataset.frames()[0].regions
