"""Validation: its measurements against known answers, and that wrong sensors fail it."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest
from stage_harness import Z_MAX, z_mean, z_sd

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
    measure,
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

RNG = np.random.default_rng(5)


def box_noise(frames: int, side: int, sigma: float) -> measure.Array:
    """White noise after a 3 x 3 box filter, of standard deviation sigma."""
    white = RNG.normal(0, 3 * sigma, (frames, side + 2, side + 2))
    parts = [white[:, r : r + side, c : c + side] for r in range(3) for c in range(3)]
    return np.asarray(np.mean(parts, axis=0))


def tilted_plane(side: int) -> measure.Array:
    rows, columns = np.mgrid[:side, :side]
    return np.asarray(900 + 0.7 * rows - 0.3 * columns)


# --- measurements -------------------------------------------------------------------------------


def test_sigma_of_known_noise_on_a_tilted_plane() -> None:
    noise = RNG.normal(0, 1.3, (40, 64, 64))
    frames = tilted_plane(64) + noise
    assert abs(z_sd(measure.without_plane(frames), 1.3)) < Z_MAX
    assert measure.sigma_spatial(frames) == pytest.approx(1.3, rel=0.01)
    assert measure.sigma_temporal(frames) == pytest.approx(1.3, rel=0.02)


def test_temporal_part_is_unbiased_and_leaves_the_fixed_pattern_out() -> None:
    pattern = RNG.normal(0, 5.0, (48, 48))
    part = measure.temporal_part(pattern + RNG.normal(0, 0.8, (12, 48, 48)))
    assert abs(float((part**2).mean()) / 0.64 - 1) < 0.03
    assert abs(z_mean(part)) < Z_MAX


@pytest.mark.parametrize("frames", [4, 64])
def test_temporal_sigma_is_unbiased_for_any_number_of_frames(frames: int) -> None:
    found = measure.sigma_temporal(RNG.normal(0, 2.0, (frames, 100, 100)))
    assert found == pytest.approx(2.0, rel=0.02)


def test_holes_do_not_count() -> None:
    frames = tilted_plane(32) + RNG.normal(0, 1.0, (60, 32, 32))
    whole = measure.sigma_temporal(frames)
    frames[RNG.random(frames.shape) < 0.2] = np.nan
    frames[:, 3, 3] = np.nan
    assert measure.sigma_temporal(frames) == pytest.approx(whole, rel=0.05)
    assert np.isfinite(measure.sigma_spatial(frames))
    assert np.isnan(measure.sigma_temporal_map(frames)[3, 3])
    assert np.isnan(measure.sigma_spatial(np.full((2, 4, 4), np.nan)))


def test_autocorrelation_of_box_filtered_noise() -> None:
    found = measure.autocorrelation(
        box_noise(60, 96, 1.0), [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (2, 2)]
    )
    assert found == pytest.approx([1, 2 / 3, 1 / 3, 0, 4 / 9, 1 / 9], abs=0.015)


def test_autocorrelation_of_white_noise_is_nothing() -> None:
    samples = RNG.normal(0, 1, (20, 64, 64))
    found = measure.autocorrelation(samples, [(0, 1), (1, 1), (0, 8)])
    assert np.abs(found * np.sqrt(samples.size)).max() < Z_MAX


def test_temporal_autocorrelation_of_white_and_of_repeated_noise() -> None:
    white = RNG.normal(0, 1, (24, 48, 48))
    assert abs(measure.temporal_autocorrelation(white)) * np.sqrt(white.size) < Z_MAX
    assert measure.temporal_autocorrelation(np.repeat(white, 2, axis=0)) > 0.4


def test_fixed_pattern_without_what_noise_leaves_in_the_mean() -> None:
    pattern = RNG.normal(0, 0.5, (64, 64))
    frames = tilted_plane(64) + pattern + RNG.normal(0, 2.0, (50, 64, 64))
    assert measure.fixed_pattern(frames)[1] == pytest.approx(0.5, rel=0.05)
    assert measure.fixed_pattern(frames - pattern)[1] < 0.08


def test_edge_jitter_of_a_slanted_edge_is_that_of_its_pixels() -> None:
    rows, columns = np.mgrid[:64, :64]
    sharp = np.where(columns + 0.5 < 30 + 0.09 * rows, 900.0, 1500.0)[None].repeat(8, axis=0)
    assert measure.edge_jitter(measure.edge_positions(sharp, 900, 1500)) == pytest.approx(
        12**-0.5, abs=0.02
    )
    moved = 30 + 0.09 * rows + RNG.normal(0, 0.7, (200, 64, 1))
    jittered = np.where(columns + 0.5 < moved, 900.0, 1500.0)
    assert measure.edge_jitter(measure.edge_positions(jittered, 900, 1500)) == pytest.approx(
        np.hypot(0.7, 12**-0.5), rel=0.05
    )


def test_mixed_pixels_are_counted_by_row() -> None:
    frames = np.full((2, 4, 8), 900.0)
    frames[:, :, 4:] = 1500.0
    frames[:, 0, 4], frames[:, 1, 4], frames[:, 2, 4] = 1200.0, 1700.0, np.nan
    assert measure.mixed_per_row(frames, 900, 1500) == (0.25, 0.25, 0.25)


def test_sinusoids_are_told_apart_from_a_trend() -> None:
    z = np.arange(600.0, 3001.0, 20.0)
    error = 4 + 0.003 * z + 2 * np.sin(2 * np.pi * z / 625 + 1) + RNG.normal(0, 0.05, z.size)
    amplitudes, deviations, left = measure.sinusoids(z, error, (3125, 1562, 625, 417, 468))
    assert amplitudes[2] == pytest.approx(2, abs=0.05)
    assert amplitudes[4] < Z_MAX * deviations[4]
    assert left < 0.08
    assert np.abs(measure.without_trend(z, error)).max() == pytest.approx(2, rel=0.2)


def test_half_point_and_its_absence() -> None:
    x = np.array([1.0, 2.0, 3.0, 4.0])
    assert measure.crossing(x, np.array([0.0, 0.25, 0.75, 1.0]), 0.5) == pytest.approx(2.5)
    assert np.isnan(measure.crossing(x, np.ones(4), 0.5))
    assert np.isnan(measure.crossing(x, np.zeros(4), 0.5))


def test_normals_of_a_plane_and_their_error() -> None:
    side, focal = 32, 300.0
    rays = np.stack(np.meshgrid(*[(np.arange(side) - 15.5) / focal] * 2), axis=-1)
    tilt = np.radians(30)
    plane = 900 / (1 - np.tan(tilt) * rays[..., 0])
    flat = measure.normals(np.full((side, side), 900.0), rays)
    found = measure.normals(plane, rays)
    assert np.nanmax(np.abs(flat - [0, 0, -1])) < 1e-9
    assert measure.angular_error_deg(found, flat) == pytest.approx(30, abs=1e-6)


def test_masks() -> None:
    mask = np.zeros((9, 12), bool)
    mask[2:7, 2:9] = True
    assert measure.eroded(mask, 2).sum() == 1 * 3
    assert measure.longest_run(mask) == 7
    step = np.full((5, 6), 900.0)
    step[:, 3:] = 1000.0
    step[0, 0] = np.nan
    assert measure.steps_mm(step)[2].tolist() == [0, 0, 100, 100, 0, 0]


def test_published_curves() -> None:
    assert curves.fankhauser_mm(0.9) == pytest.approx(1.293)
    assert curves.fankhauser_mm(0.9, np.radians(60)) - curves.fankhauser_mm(0.9) == pytest.approx(
        0.34, abs=0.005
    )
    assert curves.nguyen_mm([0.9, 3, 4]) == pytest.approx([1.68, 14.0, 25.8], rel=0.01)
    assert curves.kde_phase_sigma_rad(50.0) == pytest.approx([0.033, 0.024, 0.040], rel=0.05)
    assert curves.tap_phase_sigma_rad(50.0) == pytest.approx([0.033, 0.024, 0.040], rel=0.11)
    assert curves.white_sigma_mm(391 / 0.81) == pytest.approx(0.40, abs=0.02)
    assert curves.shadow_px(0.045, 365.456, 0.9, 2.0) == pytest.approx(10.05, abs=0.01)


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
