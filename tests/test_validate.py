"""Validation: its sheet, and that wrong sensors fail it."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest

from glsim.cli import main
from glsim.errors import ConfigError
from glsim.sensor import SENSOR_FOLDER
from glsim.validate import (
    Bench,
    Lab,
    curves,
    depth,
    edges,
    heads,
    phases,
    report,
    run,
    scenes,
    sheet_v2,
    structured,
    walls,
)
from glsim.validate.report import Band, Check, Measured, Outcome, Report

figure_module = importlib.import_module("glsim.validate.figure")  # the name is its function's

# --- the sheet ----------------------------------------------------------------------------------


def test_the_sheet_has_all_thirty_checks_and_says_what_the_design_says() -> None:
    assert [check.number for check in sheet_v2.CHECKS] == [str(n) for n in range(1, 31)]
    bands = {c.number: [(b.low, b.high) for b in c.bands] for c in sheet_v2.CHECKS}
    assert bands["1"] == [(1.0, 1.7)]
    assert bands["3"] == [(1.1, 1.8), (1.3, 2.1), (2.1, 3.4), (3.3, 5.5)]
    assert bands["6"] == [(1.0, 1.3), (1.05, 1.6), (1.25, 3.8), (1.45, 6.0)]
    assert bands["12"] == [(0.62, 0.72), (0.27, 0.36), (-0.05, 0.05), (0.42, 0.50), (0.07, 0.13)]
    assert bands["20"][:3] == [(2.3, 4.3), (6.3, 8.3), (9.1, 11.1)]
    assert bands["9"][0] == pytest.approx((0.068, 0.102))


def outcome(value: float | None, why_not: str = "", exception: str = "") -> Outcome:
    check = Check("1", "noise", (Band("a", 1.0, 2.0, "mm"), Band("b", 0.0, 1.0)), "me | you")
    return Outcome(check, Measured({"a": 1.5, "b": value}, "seen", why_not, exception))


def test_states() -> None:
    assert outcome(0.5).state == "pass"
    assert outcome(1.5).state == "FAIL"
    assert outcome(float("nan")).state == "FAIL"
    assert outcome(None).state == "pass"
    assert outcome(1.5, why_not="not here").state == "n/a"
    assert outcome(1.5, exception="known").state == "exception"
    assert outcome(0.5, exception="known").note == "seen"
    missing = Outcome(outcome(0.5).check, Measured({"a": 1.5}))
    assert missing.state == "FAIL"


def test_report_passes_with_exceptions_only_and_is_written_in_full() -> None:
    good = Report("s", "title", "sheet", 0, 8, 1.0, (outcome(0.5), outcome(1.5, exception="known")))
    assert good.passed
    bad = replace(good, outcomes=(outcome(0.5), outcome(float("nan"))))
    assert not bad.passed
    numbers = json.loads(json.dumps(bad.as_json(), allow_nan=False))["checks"][1]["numbers"]
    assert numbers[1] == {
        "key": "b", "measured": None, "low": 0.0, "high": 1.0, "unit": "", "inside": False,
    }  # fmt: skip
    row = bad.as_markdown().splitlines()[3]
    assert "b ? !" in row
    assert "me \\| you" in row
    assert "1 pass, 1 FAIL" in bad.summary


def test_a_check_without_measurement_is_an_error() -> None:
    with pytest.raises(ConfigError, match="no measurement for the checks 1"):
        report.complete([outcome(0.5).check], {})


def test_scenes_face_the_camera() -> None:
    for mesh in (scenes.wall(900), scenes.tilted(900, 60), scenes.depth_ramp(900, 50, 20)):
        a, b, c = mesh.vertices_mm[mesh.faces[0]].astype(np.float64)
        assert np.cross(b - a, c - a)[2] < 0


# --- sensors ------------------------------------------------------------------------------------


def failed(found: dict[str, Measured]) -> set[str]:
    checks = {c.number: c for c in (*sheet_v2.CHECKS, *sheet_v2.ANTI_CHECKS)}
    return {n for n, m in found.items() if Outcome(checks[n], m).state == "FAIL"}


def lab(context: moderngl.Context, sensor: str | Path, frames: int = 16) -> Lab:
    return Lab(Bench(str(sensor), context, frames=frames))


def test_kinect_v2_has_the_noise_of_a_kinect_v2(context: moderngl.Context) -> None:
    at = lab(context, "kinect-v2", 24)
    found: dict[str, Measured] = {}
    for examination in (
        walls.noise_level, walls.albedo, walls.correlations, walls.exponent, walls.skin,
        phases.phases, depth.quantisation, edges.mixed, heads.heads,
    ):  # fmt: skip
        found |= examination(at)
    assert failed(found) == set()


def test_white_noise_is_found_out(context: moderngl.Context) -> None:
    found = walls.correlations(lab(context, "kinect-v2-fankhauser"))
    assert failed(found) == {"12", "A5"}


def test_too_much_noise_is_found_out(context: moderngl.Context, tmp_path: Path) -> None:
    text = (SENSOR_FOLDER / "kinect-v2.toml").read_text()
    loud = tmp_path / "loud.toml"
    loud.write_text(text.replace('use = "tof_floor"', 'use = "tof_floor"\nsigma_mm = 4'))
    at = lab(context, loud)
    found = {**walls.noise_level(at), **walls.skin(at), **heads.heads(at)}
    assert failed(found) >= {"1", "2", "3", "4", "A4", "30"}


def test_structured_light_is_found_out(context: moderngl.Context) -> None:
    at = lab(context, "kinect-v1")
    found = {**depth.quantisation(at), **walls.exponent(at), **walls.skin(at), **edges.mixed(at)}
    assert failed(found) >= {"22", "A1", "18"}


def test_a_chain_without_phases_is_not_asked_for_them(context: moderngl.Context) -> None:
    at = lab(context, "kinect-v2-fankhauser", 8)
    found = {**phases.phases(at), **walls.albedo(at)}
    assert all("looks into" in m.why_not for m in found.values())


@pytest.mark.parametrize("sensor", ["kinect-v1", "kinect-v2-paper"])
def test_structured_light_sensors_are_what_they_say(context: moderngl.Context, sensor: str) -> None:
    found = run.examine(lab(context, sensor, 24))
    assert [o.check.number for o in found.outcomes if o.state != "pass"] == []


@pytest.fixture
def _few_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests in which numbers do not matter."""
    monkeypatch.setattr(walls, "_PATTERN_FRAMES", 16)
    monkeypatch.setattr(depth, "_WIGGLE_FRAMES", 1)


@pytest.mark.usefixtures("_few_frames")
def test_a_sensor_that_sees_nearly_nothing_fails_and_does_not_break(
    context: moderngl.Context, tmp_path: Path
) -> None:
    text = (SENSOR_FOLDER / "kinect-v2-fankhauser.toml").read_text()
    (tmp_path / "blind.toml").write_text(text.replace("near_mm = 500 ", "near_mm = 4400 "))
    found = run.examine(lab(context, tmp_path / "blind.toml", 8))
    assert {o.check.number for o in found.outcomes if o.state == "pass"} < {
        "8", "19", "20", "24", "28", "29", "A3",
    }  # fmt: skip
    assert not found.passed


@pytest.mark.usefixtures("_few_frames")
def test_a_sensor_without_noise_fails_and_does_not_break(context: moderngl.Context) -> None:
    found = run.examine(lab(context, "ideal", 8))
    states = {o.check.number: o.state for o in found.outcomes}
    assert {n for n in ("1", "2", "5", "12", "13", "27", "30") if states[n] != "FAIL"} == set()


def test_without_matplotlib_it_says_so_first(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(figure_module, "find_spec", lambda _: None)
    assert main(["validate", "kinect-v2", "--figure", "x.png"]) == 2
    assert "pip install 'glsim[eval]'" in capsys.readouterr().err


def test_a_scene_is_a_function_of_the_seed(context: moderngl.Context) -> None:
    at = lab(context, "kinect-v2", 8)
    first, again, other = (
        at.bench.shoot(scenes.wall(900), 2, 24, at_mm=(0, 0, 900), seed=seed) for seed in (1, 1, 2)
    )
    assert np.array_equal(first.encoded, again.encoded)
    assert not np.array_equal(first.encoded, other.encoded)
    assert not np.array_equal(first.encoded[0], first.encoded[1])


def test_shadow_widths_of_the_infrared(context: moderngl.Context) -> None:
    found = structured.v1_shadow(lab(context, "kinect-v1", 8))["6"]
    assert found.values["1.5 m"] == pytest.approx(curves.shadow_px(0.075, 580, 0.9, 1.5), abs=1)


# --- the command --------------------------------------------------------------------------------


@pytest.mark.usefixtures("_few_frames")
def test_command_writes_table_json_and_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / f"out/{name}" for name in ("checks.json", "figure.png", "table.md")}
    status = main([
        "validate", "kinect-v2-paper", "--frames", "8", "--json", str(files["checks.json"]),
        "--figure", str(files["figure.png"]), "--markdown", str(files["table.md"]),
    ])  # fmt: skip
    printed = capsys.readouterr()
    assert "9 x 9 window" in printed.out
    assert "kinect-v2-paper: 10 checks: 10 pass" in printed.err
    assert status == 0
    assert json.loads(files["checks.json"].read_text())["passed"] is True
    assert files["figure.png"].read_bytes().startswith(b"\x89PNG")
    assert files["table.md"].read_text().count("\n") == 12


def test_command_fails_for_a_wrong_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet = run.Sheet("other", sheet_v2.CHECKS[:5], (walls.noise_level,))
    monkeypatch.setitem(run.SHEETS, "kinect-v1", sheet)
    assert main(["validate", "kinect-v1", "--frames", "8"]) == 1
    assert "FAIL" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "no such sensor 'nothing'"),
        (["kinect-v1", "--figure", "x.pdf"], "give a name that ends in .png"),
    ],
)
def test_command_refuses(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["validate", *arguments]) == 2
    line = capsys.readouterr().err
    assert message in line
    assert line.count("\n") == 1
