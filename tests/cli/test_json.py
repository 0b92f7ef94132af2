"""Commands that print a table print JSON, too; the others that make tables write it to files."""

from __future__ import annotations

import json
import math

import pytest

from glsim import load_sensor, sensor_names
from glsim.cli import main
from glsim.noise.registry import stage_names


def printed(capsys: pytest.CaptureFixture[str], *command: str) -> object:
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


def test_info(capsys: pytest.CaptureFixture[str]) -> None:
    found = printed(capsys, "info")
    assert found["versions"].keys() >= {"glsim", "numpy"}
    assert "used" in {entry["state"] for entry in found["backends"]}
