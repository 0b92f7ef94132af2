"""The validation sheets: shipped sensors pass theirs, and wrong sensors fail them."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.bench.validate import Captures, run
from glsim.bench.validate.checks import depth_edges as edges
from glsim.bench.validate.checks import faces, phases, walls
from glsim.bench.validate.checks.triangulation import board_measurements
from glsim.bench.validate.report import Band, Check, CheckResult, Measurement, ValidationReport
from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.core.files.png import read_image
from glsim.data.maps import open_maps
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor, shipped_sensors
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.real_cameras import (
    REAL_KINECT_V2,
    needs_real_cameras,
    needs_real_kinect_v2,
    real_disparities,
)

TRUEDEPTHS = ("iPadPro12_4gen_iOS15", "iPhone11Pro_iOS14")


def captures_of(context: Context, sensor: str | Path, frames: int = 16) -> Captures:
    return Captures(VirtualCamera(str(sensor), context, frames=frames))


def failed(measurements: dict[str, Measurement]) -> set[str]:
    checks = {c.number: c for c in run.sheets()["kinect-v2"].checks}
    return {n for n, m in measurements.items() if CheckResult(checks[n], m).state == "FAIL"}


def result(value: float | None, why_not: str = "", exception: str = "") -> CheckResult:
    check = Check("1", "noise", (Band("a", 1.0, 2.0, "mm"), Band("b", 0.0, 1.0)), "me | you")
    return CheckResult(check, Measurement({"a": 1.5, "b": value}, "seen", why_not, exception))


def test_states() -> None:
    assert result(0.5).state == "pass"
    assert result(1.5).state == "FAIL"
    assert result(float("nan")).state == "FAIL"
    assert result(None).state == "pass"
    assert result(1.5, why_not="not here").state == "n/a"
    assert result(1.5, exception="known").state == "exception"
    assert result(0.5, exception="known").cells[-1] == "seen"
    missing = CheckResult(result(0.5).check, Measurement({"a": 1.5}))
    assert missing.state == "FAIL"


def test_report_passes_with_exceptions_only_and_is_written_in_full() -> None:
    good = ValidationReport(
        "s", "title", "sheet", 0, 8, 1.0, (result(0.5), result(1.5, exception="known"))
    )
    assert good.passed
    bad = replace(good, results=(result(0.5), result(float("nan"))))
    assert not bad.passed
    numbers = json.loads(json.dumps(bad.as_json(), allow_nan=False))["checks"][1]["numbers"]
    assert numbers[1] == {
        "key": "b", "measured": None, "low": 0.0, "high": 1.0, "unit": "", "inside": False,
    }  # fmt: skip
    row = bad.as_markdown().splitlines()[3]
    assert "b ? !" in row
    assert "me \\| you" in row
    assert "1 pass, 1 FAIL" in bad.summary


def test_a_check_without_measurement_is_an_error(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet = run.ValidationSheet("other", (result(0.5).check,), ())
    monkeypatch.setitem(run.sheets(), "ideal", sheet)
    with pytest.raises(ConfigError, match="no measurement for the checks 1"):
        run.run_checks(captures_of(context, "ideal").camera)


@pytest.mark.parametrize(
    ("sensor", "frames", "missed"),
    [
        pytest.param("kinect-v1", 24, set(), marks=pytest.mark.long),
        ("kinect-v2-paper", 24, set()),
        pytest.param("kinect-v2", 16, {"31", "32", "33", "35"}, marks=pytest.mark.long),
        pytest.param("azure-kinect", 8, set(), marks=pytest.mark.long),
        pytest.param("azure-kinect-nfov-binned", 8, {"4", "5"}, marks=pytest.mark.long),
        pytest.param("realsense-d435", 64, set(), marks=pytest.mark.long),
        pytest.param("realsense-d455", 64, set(), marks=pytest.mark.long),
        pytest.param("realsense-d415-high-accuracy", 64, set(), marks=pytest.mark.long),
        pytest.param("realsense-d4xx-fast", 64, set(), marks=pytest.mark.long),
        pytest.param("truedepth", 64, set(), marks=pytest.mark.long),
        pytest.param("kinect-v1-pattern", 64, set(), marks=pytest.mark.long),
    ],
)
def test_the_sheet_passes_but_for_what_docs_validation_says(
    context: Context, sensor: str, frames: int, missed: set[str]
) -> None:
    made = run.run_checks(captures_of(context, sensor, frames).camera)
    assert len(made.results) >= 3
    failed = {r.check.number for r in made.results if r.state not in ("pass", "exception")}
    assert failed == missed


def held(sheet: str, measured: dict[str, Measurement]) -> set[str]:
    """The states of measured checks of a sheet."""
    checks = {check.number: check for check in run.sheets()[sheet].checks}
    return {CheckResult(checks[number], m).state for number, m in measured.items()}


@needs_real_kinect_v2
@pytest.mark.long
def test_bands_of_gaps_hold_the_real_frames() -> None:
    """The same code as on simulated frames, which miss some of them."""
    frames = open_maps(REAL_KINECT_V2).read(60, None)
    assert held("kinect-v2", edges.gap_measurements(frames)) == {"pass"}


@needs_real_cameras
@pytest.mark.parametrize(
    "folder", [f"{kind}_{device}" for kind in ("board", "eval") for device in TRUEDEPTHS]
)
@pytest.mark.long
def test_bands_of_boards_hold_the_real_frames(folder: str) -> None:
    disparity = real_disparities(f"truedepth_zeiss/{folder}", 10_000.0)  # 1/m of 0.1 mm
    assert held("truedepth", board_measurements(disparity)) == {"pass"}


def test_the_law_of_the_tilt_is_that_of_real_frames(context: Context) -> None:
    """kinect-v2 holds it; Fankhauser's curve with its lateral jitter says several times more."""
    assert failed(walls.tilt(captures_of(context, "kinect-v2"))) == set()
    other = walls.tilt(captures_of(context, "kinect-v2-fankhauser"))
    assert failed(other) == {"6"}


def test_white_noise_is_found_out_and_phases_are_not_asked_for(context: Context) -> None:
    captures = captures_of(context, "kinect-v2-fankhauser", 8)
    assert failed(walls.correlations(captures)) == {"12", "A5"}
    internal = {**phases.phase_noise(captures), **walls.albedo(captures)}
    assert all("time-of-flight chain" in m.why_not for m in internal.values())


@pytest.mark.long
def test_too_much_noise_is_found_out(context: Context, tmp_path: Path) -> None:
    text = (SENSOR_FOLDER / "kinect-v2.toml").read_text()
    loud = tmp_path / "loud.toml"
    loud.write_text(re.sub(r'(use = "tof_floor"\nsigma_mm = )[^\n]*', r"\g<1>4", text))
    captures = captures_of(context, loud)
    measurements = {
        **walls.noise_level(captures),
        **walls.near_walls(captures),
        **faces.isolated_faces(captures),
    }
    assert failed(measurements) >= {"1", "2", "3", "4", "A4", "30"}


@pytest.mark.parametrize(
    ("change", "rows"),
    [
        ("rim_px = 0\nborder_px = 0", {"7", "8"}),
        ("support_px = 1\nwindow_px = 3", {"1", "2"}),
        pytest.param("texture_counts = 6.0", {"10"}, marks=pytest.mark.long),
        pytest.param("uniqueness_percent = 80", {"11"}, marks=pytest.mark.long),
        pytest.param(
            "depth_unit_mm = 1\ndevice_sigma_px = 0.3\ndevice_grain_px = 2",
            {"3"},
            marks=pytest.mark.long,
        ),
    ],
)
@pytest.mark.long
def test_the_sheet_notices_another_matcher(
    context: Context, tmp_path: Path, change: str, rows: set[str]
) -> None:
    file = tmp_path / "other.toml"
    file.write_text(
        f'extends = "realsense-d435"\ntitle = "t"\n[[stage]]\nuse = "match_stereo"\n{change}\n'
    )
    results = run.run_checks(captures_of(context, file).camera).results
    assert {result.check.number for result in results if result.state == "FAIL"} >= rows


def test_command_writes_table_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(tmp_path / "out" / name) for name in ("checks.json", "table.md", "a.png")]
    arguments = ["--frames", "8", "--json", files[0], "--markdown", files[1], "--figure", files[2]]
    assert main(["validate", "kinect-v2-paper", *arguments]) == 0
    printed = capsys.readouterr()
    assert "9 x 9 window" in printed.out
    assert "kinect-v2-paper: 10 checks: 10 pass" in printed.err
    assert "AUC" not in printed.err  # no real frame of it
    assert json.loads(Path(files[0]).read_text())["passed"] is True
    assert Path(files[1]).read_text().count("\n") == 12
    assert len(np.unique(read_image(Path(files[2])))) > 10


def test_command_fails_for_a_wrong_sensor_and_refuses_an_unknown_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = run.sheets()["kinect-v2"].checks[:5]
    sheet = run.ValidationSheet("other", checks, (walls.noise_level,))
    monkeypatch.setitem(run.sheets(), "kinect-v1", sheet)
    assert main(["validate", "kinect-v1", "--frames", "8"]) == 1
    assert "FAIL" in capsys.readouterr().out
    for sensor, message in (
        ("nothing", "no such sensor 'nothing'"),
        ("oak-d-pro", "no published measure: in the file of a camera alike"),
    ):
        assert main(["validate", sensor]) == 2
        assert message in capsys.readouterr().err


def test_sensors_name_sheets_that_exist_and_their_files_inherit_them() -> None:
    named = {name: load_sensor(name).sheet for name in shipped_sensors()}
    assert set(named.values()) <= {"", *run.sheets()}
    assert named["femto-bolt"] == "azure-kinect"
    assert named["truedepth-filtered"] == ""
