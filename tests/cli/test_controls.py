"""Sliders from declarations."""

from pathlib import Path

import pytest

from glsim.cli.tune_page.controls import (
    Control,
    parameter_control,
    pose_controls,
    stage_controls,
    wall_control,
)
from glsim.core.errors import ShaderError
from glsim.gl.shader_source import parse_source
from glsim.sensors.sensor import load_sensor, sensor_names
from glsim.settings.distribution import constant
from glsim.settings.schema import load_settings, with_assignments


def declared(note: str, kind: str = "float", default: str = "2.0") -> Control:
    text = f"#version 330 core\nuniform {kind} x = {default}; //@ {note}\nout float depth;\n"
    parameter = parse_source(text, Path("own.glsl")).parameters["x"]
    return parameter_control("own.x", parameter, constant(parameter.default))


def test_a_range_far_beyond_the_value_is_shown_in_part() -> None:
    control = declared("[0, 65535] counts gain")
    assert (control.low, control.high, control.least, control.most) == (0, 65535, 0, 10)
    assert declared("[-50, 50] mm shift").least == -10
    assert declared("[0, 3] mm shift").most == 3
    assert declared("[0, 50] mm shift", default="0.0").most == 50


def test_a_note_may_give_the_sliders_own_range_and_scale() -> None:
    control = declared("[0, 65535; 0.5, 2000] counts gain")
    assert (control.high, control.least, control.most) == (65535, 0.5, 2000)
    control = declared("[0.01, 1e6; log] 1 threshold")
    assert control.log_scale
    assert control.position(100) == 2
    assert control.value(2) == 100
    control = declared("[0, 1e6; 1, 100 log] 1 threshold")
    assert (control.least, control.most, control.log_scale) == (1, 100, True)
    assert control.value(control.position(0.0)) == 1, "0 has no logarithm: the slider's end"


def test_a_wrong_note_names_its_line() -> None:
    for note in ("", "lin", "5", "5, 5", "0, 11", "log", "a, b", "step", "step 0", "step 11"):
        with pytest.raises(ShaderError, match=r"own\.glsl:2: .*'x'"):
            declared(f"[0, 10; {note}] mm help")


def test_sliders_of_windows_keep_them_odd() -> None:
    control = declared("[3, 21; step 2] px window", kind="int", default="9")
    assert (control.least, control.most, control.step) == (3, 21, 2)
    (matcher,) = (s for s in load_sensor("realsense-d435").stages if s.name == "match_stereo")
    sliders = {c.label: c for c in stage_controls(matcher)}
    for name in ("window_px", "support_px", "contrast_px"):
        slider = sliders[name]
        assert (slider.step, slider.least % 2) == (2, 1), name
    assert sliders["p2"].step == 1
    assert sliders["contrast_px"].low == 0, "a box takes 0: switched off"


@pytest.mark.parametrize("name", sensor_names())
def test_every_parameter_of_every_sensor_has_a_slider_that_holds_its_value(name: str) -> None:
    sensor = load_sensor(name)
    for stage in sensor.stages:
        controls = stage_controls(stage)
        assert {c.label for c in controls} == set(stage.spec.parameters)
        for control in controls:
            low, high = control.start.bounds()
            assert control.low <= control.least < control.most <= control.high
            assert control.least <= low <= high <= control.most, control.name
            assert control.value(control.position(low)) == pytest.approx(low, rel=1e-4)


def test_pose_and_wall_are_settings() -> None:
    settings = load_settings()
    for control in [*pose_controls(settings), wall_control(settings)]:
        for value in (control.low, control.high):
            if control.name != "scene.wall_mm":
                with_assignments(settings, {control.name: value})
        assert control.low <= control.least < control.most <= control.high
    assert with_assignments(settings, {"scene.wall_mm": 1800}).scene.wall_mm == constant(1800)
