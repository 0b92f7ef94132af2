"""What the page remembers: values and undo; and what it writes as text."""

import shlex

from glsim.cli.tune_page.tuning import History, StageCode, Tuning, python_code, set_options
from glsim.settings.schema import load_settings, with_assignments

START = Tuning("kinect-v1")


def test_a_dragged_slider_is_one_step_back() -> None:
    history = History(START)
    for value in (1, 2, 3):
        assert history.change(history.now.with_value("axial.angle_mm", value), "axial.angle_mm")
    history.settle()
    history.change(history.now.with_value("axial.angle_mm", 4), "axial.angle_mm")
    history.change(history.now.with_value("seed", 2), "seed")
    assert history.undo().values == {"axial.angle_mm": 4}
    assert history.undo().values == {"axial.angle_mm": 3}
    assert history.undo() == START
    assert not history.can_undo
    assert history.undo() == START
    assert history.redo().values == {"axial.angle_mm": 3}
    history.change(history.now.with_value("seed", 9))
    assert not history.can_redo
    assert not history.change(history.now), "nothing has changed"


def test_a_tuning_that_cannot_be_drawn_is_forgotten() -> None:
    history = History(START)
    history.change(START.with_value("seed", 1), "seed")
    bad = history.now.with_value("axial.enabled", False)
    history.change(bad)
    assert history.refuse(bad)
    assert history.now == START.with_value("seed", 1)
    assert not history.can_redo
    assert not history.refuse(bad), "it is no longer the current one"
    history.undo()
    assert not history.refuse(history.now), "the first one stays"


def test_a_new_stage_that_is_taken_back_takes_its_values_along() -> None:
    own = START.with_code("mine", StageCode("text", "low_signal", new=True))
    own = own.with_value("mine.amount_mm", 3).with_value("axial.angle_mm", 1)
    assert own.with_code("mine", None) == START.with_value("axial.angle_mm", 1)


def test_the_copied_options_give_the_same_settings() -> None:
    values = {
        "axial.base_sigma_mm": 2.5,
        "axial.enabled": False,
        "pose.yaw_deg": {"uniform": [-30, 30]},
        "rig.focal_px": [500, 500],
        "rig.emitter": [{"position_m": [0.1, 0, 0]}],
    }
    words = shlex.split(set_options(Tuning("kinect-v1", values)))
    assert words[:2] == ["--sensor", "kinect-v1"]
    assert words[2::2] == ["--set"] * len(values)
    of_options = load_settings(None, words[3::2], {"sensor": "kinect-v1"})
    assert of_options == with_assignments(load_settings(overrides={"sensor": "kinect-v1"}), values)


def test_the_copied_python_is_python() -> None:
    tuning = Tuning("ideal", {"seed": 1}, {"mine": StageCode('a "quoted"\ntext', "axial", True)})
    code = python_code(tuning)
    compile(code, "copied", "exec")
    assert "before='axial'" in code
    assert "{'seed': 1}" in code
