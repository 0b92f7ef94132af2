"""Stages on arrays: despeckle, and functions of the user's own."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.noise.array_stages import despeckle
from glsim.noise.registry import find_stage
from glsim.sensors.sensor import load_sensor
from tests.support.scenes import frames_of, plate, sensor_file, settings_for
from tests.support.stage_harness import frame

MINE = """
import numpy as np
from glsim import array_stage

@array_stage(by_mm=("float", 3.0, 0.0, 50.0, "mm", "how far"))
def farther(view, layers, p):
    "Moves the depth back where it is lit."
    depth = np.where(layers["lit"] > 0.5, layers["depth"] + p["by_mm"] / 1000, 0)
    depth[layers["normal"][..., 2] > -0.5] = 0
    assert layers["albedo"].shape == depth.shape == (view.window.height, view.window.width)
    return {"depth": depth.astype(np.float64), "heat": np.ones((2, 2))}

@array_stage()
def wrong_shape(view, layers, p):
    return {"depth": layers["depth"][1:]}

@array_stage()
def not_a_number(view, layers, p):
    return {"depth": layers["depth"] * np.float32("nan")}

@array_stage()
def odd_reason(view, layers, p):
    return {"reason": np.full_like(layers["depth"], np.nan)}

def not_marked(view, layers, p):
    return {}
"""


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(MINE)
    return tmp_path


def test_a_users_function_is_a_stage(context: moderngl.Context, mine: Path) -> None:
    sensor = sensor_file(mine, 'use = "mine.py:farther"\nby_mm = { choice = [10] }')
    (made,) = frames_of(context, settings_for(sensor), plate())
    assert set(np.unique(made.noisy[made.clean > 0])) == {910}
    assert made.parameters == {"farther.by_mm": 10.0}
    off = settings_for(sensor, stage={"farther": {"enabled": False}})
    (made,) = frames_of(context, off, plate())
    assert set(np.unique(made.noisy)) == {0, 900}


@pytest.mark.parametrize(
    ("use", "message"),
    [
        ("wrong_shape", r"stage 'wrong_shape' returned 'depth' of shape \(\d+, \d+\), not "),
        ("not_a_number", r"left NaN or infinity in \d+ pixels of the depth"),
        ("odd_reason", r"left NaN or infinity in \d+ pixels of the reason"),
    ],
)
def test_nonsense_from_a_function_is_named(
    context: moderngl.Context, mine: Path, use: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        frames_of(context, settings_for(sensor_file(mine, f'use = "mine.py:{use}"')), plate())


@pytest.mark.parametrize(
    ("use", "message"),
    [
        ("mine.py:absent", "mine.py has no 'absent'"),
        ("mine.py:not_marked", "not_marked is not a stage: decorate it with @array_stage"),
        ("none.py:farther", "none.py cannot be imported: .*No such file"),
        ("no.such.module:farther", "no.such.module cannot be imported: No module named 'no"),
        ("broken.py:farther", "broken.py cannot be imported: .*invalid syntax"),
    ],
)
def test_a_function_that_is_none_is_named(mine: Path, use: str, message: str) -> None:
    (mine / "broken.py").write_text("def")
    with pytest.raises(ConfigError, match=message):
        load_sensor(sensor_file(mine, f'use = "{use}"'))


def test_despeckle_looks_as_far_as_it_declares() -> None:
    """A line of 20 px is kept if all of it is seen, and removed if one pixel less is seen."""
    p = {"min_area_px": 20, "max_step_mm": 20.0}
    depth = np.full((1, 20), 0.9, np.float32)
    reach_px = find_stage("despeckle").reach_px(p)
    for seen_px, stays in ((reach_px, True), (reach_px - 1, False)):
        seen = {"depth": depth[:, : 1 + seen_px], "reason": np.zeros((1, 1 + seen_px), np.float32)}
        assert (despeckle(frame().view("despeckle"), seen, p)["depth"][0, 0] > 0) == stays


def test_despeckle_removes_islands_below_the_area_only() -> None:
    depth = np.zeros((60, 60), np.float32)
    depth[5:9, 5:10] = 0.9  # 20 px: stays
    depth[5:9, 30:35] = 0.9
    depth[8, 34] = 0  # 19 px: goes
    depth[20:50, 20:50] = 0.9
    depth[30:33, 30:33] = 0.93  # 9 px on an island of another depth: goes
    depth[40:43, 40:43] = 0.915  # within max_step_mm of its surroundings: stays
    depth[55, 55] = 20.0
    layers = {"depth": depth, "reason": np.zeros_like(depth)}
    before = {name: layer.copy() for name, layer in layers.items()}
    at = frame().view("despeckle")
    written = despeckle(at, layers, {"min_area_px": 20, "max_step_mm": 20.0})
    gone = (depth > 0) & (written["depth"] == 0)
    expected = np.zeros_like(gone)
    expected[5:9, 30:35] = depth[5:9, 30:35] > 0
    expected[30:33, 30:33] = True
    expected[55, 55] = True
    np.testing.assert_array_equal(gone, expected)
    np.testing.assert_array_equal(written["reason"] == float(Reason.DROPPED), expected)
    np.testing.assert_array_equal(written["depth"][~gone], depth[~gone])
    for name, layer in layers.items():
        np.testing.assert_array_equal(layer, before[name])
