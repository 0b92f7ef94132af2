"""Commands that print a table print JSON, too."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from glsim import load_sensor, sensor_names
from glsim.cli import main
from glsim.noise.registry import stage_names
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.recordings import scene, write_static_pair
from tests.support.scenes import face_mesh, write_obj


def printed(capsys: pytest.CaptureFixture[str], *command: str) -> Any:
    assert main([*command, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_sensors(capsys: pytest.CaptureFixture[str]) -> None:
    found = printed(capsys, "sensors")
    assert [entry["name"] for entry in found] == list(sensor_names())
    by_name = {entry["name"]: entry for entry in found}
    v2, rig = by_name["kinect-v2"], load_sensor("kinect-v2").rig
    assert (v2["width_px"], v2["height_px"], v2["fx_px"]) == (512, 424, rig.intrinsics.fx)
    assert math.isclose(v2["baseline_mm"], 1000 * rig.baseline_m)
    assert {"name": "tof_light", "enabled": True} in v2["stages"]
    assert by_name["ideal"]["baseline_mm"] is None
    assert main(["sensors", "kinect-v2", "--json"]) == 2
    assert "is TOML" in capsys.readouterr().err


def test_stages(capsys: pytest.CaptureFixture[str]) -> None:
    assert [entry["name"] for entry in printed(capsys, "stages")] == list(stage_names())
    (axial,) = printed(capsys, "stages", "axial")
    assert {"depth"} <= {*axial["reads"]} | {*axial["writes"]}
    sigma = {p["name"]: p for p in axial["parameters"]}["base_sigma_mm"]
    assert sigma["low"] <= sigma["default"] <= sigma["high"]
    assert sigma["unit"] == "mm"


def test_a_data_set_that_is_sound_and_one_that_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    make(data, make_settings(), make_tasks(2, 2))
    found = printed(capsys, "verify", str(data))
    assert found["problems"] == []
    assert sum(found["frames"].values()) == 4
    next(data.rglob("*_noisy.png")).unlink()
    assert main(["verify", str(data), "--json", "--repair"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert "_noisy.png" in found["problems"][0]
    assert found["repair"].startswith("glsim generate")


@pytest.mark.long
def test_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_static_pair(tmp_path / "recording", scene(), 1.6)
    place = ["compare", str(tmp_path / "recording"), str(tmp_path / "recording"), "-q"]
    assert main([*place, "--json", "-"]) == 0
    on_screen = capsys.readouterr().out
    assert main([*place, "--json", str(tmp_path / "found.json")]) == 0
    assert json.loads(on_screen) == json.loads((tmp_path / "found.json").read_text())


def test_face_sets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = face_mesh()
    write_obj(tmp_path / "face.obj", mesh)
    found = printed(capsys, "inspect", str(tmp_path / "face.obj"), "--shown", "0")
    assert found["frames_read"] == 1
    assert found["vertices"] == [len(mesh.vertices_mm)] * 2


@pytest.mark.long
def test_a_fit_and_a_validation(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_static_pair(here / "recording", scene(), 1.6)
    found = printed(capsys, "fit", "recording", "-o", "mine.toml", "--no-proof")
    assert found["sensor"] == "mine.toml"
    assert "base" in found["results"]
    assert main(["validate", "kinect-v2-paper", "--frames", "8", "--json", "-"]) in (0, 1)
    assert isinstance(json.loads(capsys.readouterr().out), dict)


def test_scores_of_real_frames(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_static_pair(here / "recording", scene(), 1.6)
    found = printed(capsys, "eval-real", "recording", "-d", "median", "--no-figures", "-q")
    assert found == json.loads((here / "scores" / "scores.json").read_text())
    assert main(["eval-real", "recording", "-d", "guided", "--no-figures"]) == 0
    told = capsys.readouterr().err
    assert "states no intrinsics: those of kinect-v2 (f 365 px for " in told
    assert "table.md: replaced one with median: next time give -o NEW" in told
    (here / "recording").rename("other")
    assert main(["eval-real", "other", "-d", "guided"]) == 2
    assert "holds the scores of" in capsys.readouterr().err
