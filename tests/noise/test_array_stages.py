"""Stages on arrays: despeckle, fill_from_points, and code of the user's own."""

import os
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.array_stages import despeckle
from glsim.noise.frame_context import FrameContext
from glsim.noise.registry import declared_stage, find_stage, is_code, shipped_stages
from glsim.sensors.sensor import load_sensor, sensor_code
from glsim.settings.schema import load_settings
from tests.support.scenes import frames_of, plate, sensor_file, settings_for
from tests.support.stage_harness import HEIGHT, WIDTH, Image, crop, flat, frame, layers_of, values

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


def test_a_users_function_is_a_stage(context: Context, mine: Path) -> None:
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
        ("mine.py:wrong_shape", r"'wrong_shape' returned 'depth' of shape \(\d+, \d+\), not "),
        ("mine.py:not_a_number", r"left NaN or infinity in \d+ pixels of the depth"),
        ("mine.py:odd_reason", r"left NaN or infinity in \d+ pixels of the reason"),
        ("mine.py:absent", "mine.py has no 'absent'"),
        ("mine.py:not_marked", "not_marked is not a stage: decorate it with @array_stage"),
        ("none.py:farther", "none.py cannot be imported: .*No such file"),
        ("no.such.module:farther", "no.such.module cannot be imported: .*No module named 'no"),
        ("broken.py:farther", "broken.py cannot be imported: .*invalid syntax"),
    ],
)
def test_nonsense_from_a_function_is_named(
    context: Context, mine: Path, use: str, message: str
) -> None:
    (mine / "broken.py").write_text("def")
    with pytest.raises(ConfigError, match=message):
        frames_of(context, settings_for(sensor_file(mine, f'use = "{use}"')), plate())


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


STAGE = "fill_from_points"


def run(layers: dict[str, Image], at: FrameContext | None = None, **p: float) -> dict[str, Image]:
    at = at or frame()
    function = shipped_stages()[STAGE].function
    return dict(function(at.view(STAGE), layers, values(STAGE, p)))


def steps(near_m: float, far_m: float) -> Image:
    """The left half near, the right half far."""
    depth = np.full((HEIGHT, WIDTH), far_m, np.float32)
    depth[:, : WIDTH // 2] = near_m
    return depth


def test_a_plane_stays_where_it_is_and_becomes_smooth() -> None:
    rng = np.random.default_rng(0)
    inverse = 1 / 0.5 + rng.normal(0, 0.0065, (HEIGHT, WIDTH))
    layers = flat(0.5)
    layers["depth"] = (1 / inverse).astype(np.float32)
    layers["depth"][60:75, 90:110] = 0
    made = run(layers)
    assert (made["depth"] > 0).all()
    error_mm = 1000 * (made["depth"].astype(float) - 0.5)
    assert abs(error_mm.mean()) < 0.1
    assert error_mm.std() < 0.3 * 1000 * 0.0065 * 0.25
    assert (made["reason"] == Reason.VALID).all()
    units = made["depth"] / np.float32(1e-4)
    assert np.abs(units - np.rint(units)).max() < 2e-3, "steps of 0.1 mm"


@pytest.mark.parametrize("near_m", [0.4, 0.5, 0.7])
def test_a_silhouette_grows_in_lobes_and_its_step_is_a_ramp(near_m: float) -> None:
    """As seen on three heads: lobes of 10 to 20 px, a ramp."""
    layers = layers_of(steps(near_m, 1.6), np.array([0.0, 0.0, -1.0, 0.6]))
    depth = run(layers)["depth"].astype(float)
    share = (1 / depth - 1 / 1.6) / (1 / near_m - 1 / 1.6)
    inner = share[20:-20]
    grown = (inner > 0.5).sum(axis=1) - WIDTH // 2
    assert 8 <= grown.mean() <= 20
    assert 0.7 < grown.std() < 5, "round lobes, not a straight line"
    ramp = ((inner > 0.1) & (inner < 0.9)).sum(axis=1)
    assert 2 <= np.median(ramp) <= 8
    reason = run(layers)["reason"]
    assert (reason[:, WIDTH // 2 : WIDTH // 2 + 5] == Reason.MOVED).all()
    assert (reason[:, -40:] == Reason.VALID).all()


def test_holes_wider_than_it_reaches_stay() -> None:
    layers = flat(0.5)
    layers["depth"] = np.zeros_like(layers["depth"])
    assert not run(layers)["depth"].any()
    layers["depth"][:, :40] = 0.5
    filled = [int((run(layers, doublings=n)["depth"][100] > 0).sum()) for n in (0, 1, 2)]
    assert 55 < filled[0] < filled[1] < filled[2] < WIDTH
    nothing = flat(0.5)
    nothing["clean"] = np.zeros_like(nothing["clean"])
    assert (run(nothing)["reason"] == Reason.GROWN).all()


def test_a_window_has_the_pixels_of_the_whole_frame() -> None:
    rng = np.random.default_rng(3)
    depth = steps(0.5, 1.4)
    depth[rng.random(depth.shape) < 0.1] = 0
    depth[40:90, 100:160] = 0
    layers = layers_of(depth, np.array([0.0, 0.0, -1.0, 0.6]))
    reach = shipped_stages()[STAGE].reach_px(values(STAGE, {"doublings": 1}))
    whole = run(layers, doublings=1)["depth"]
    at = frame(window=Rect(13, 7, WIDTH - 13, HEIGHT - 7))
    part = run(crop(layers, at), at, doublings=1)["depth"]
    inner = np.s_[reach:, reach:]
    assert part[inner].size > 10_000
    assert np.array_equal(part[inner], whole[at.window.slices][inner])


CODE = """
from pathlib import Path
Path(__file__).with_name("it_ran").touch()
from glsim import array_stage

@array_stage(lambda p: 2, by_mm=("float", 10, 0, 50, "mm", "how far"))
def farther(view, layers, p):
    "Moves all depth."
    return {"depth": layers["depth"] + p["by_mm"] / 1000}

def plain(view, layers, p):
    return {}

LIMIT = 5
@array_stage(by_mm=("float", LIMIT, 0, 50, "mm", "how far"))
def computed(view, layers, p):
    return {}
"""


@pytest.fixture
def here(here: Path) -> Path:
    (here / "mine.py").write_text(CODE)
    Path(sensor_file(here, 'use = "mine.py:farther"')).rename("mine.toml")
    return here


def test_code_is_named_when_it_runs(here: Path, caplog: pytest.LogCaptureFixture) -> None:
    load_sensor("mine.toml")
    assert (here / "it_ran").exists()
    caplog.clear()
    (here / "other.py").write_text(CODE)
    for _ in range(2):  # once a process
        find_stage(f"{here / 'other.py'}:farther")
    assert caplog.messages == [
        f"runs code of {here / 'other.py'}: name only files whose author you trust"
    ]


def test_a_plan_and_a_list_run_no_code(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["generate", "--plan", "--sensor", "mine.toml", "--subjects", "2"]
    assert main([*words, "--frames-per-subject", "2"]) == 0
    assert "nothing was written" in " ".join(capsys.readouterr().out.split())
    assert main(["stages", "mine.py:farther"]) == 0
    listing = capsys.readouterr().out
    assert "farther: Moves all depth." in listing
    assert "by_mm" in listing
    assert not (here / "it_ran").exists()


def test_what_a_sensor_would_run(here: Path) -> None:
    assert sensor_code(load_settings(overrides={"sensor": "mine.toml"})) == ["mine.py:farther"]
    assert sensor_code(load_settings()) == []
    assert is_code("package.module:stage")
    assert not is_code("axial")
    assert not is_code("a:b.glsl")


def test_a_declaration_is_read_from_the_text(here: Path) -> None:
    spec = declared_stage(here / "mine.py", "farther")
    run = find_stage("mine.py:farther", here)
    assert spec.parameters.keys() == run.parameters.keys()
    assert spec.parameters["by_mm"].default == run.parameters["by_mm"].default == 10
    assert spec.title == run.title
    (here / "broken.py").write_text("def")
    os.mkfifo(here / "pipe.py")
    for use, problem in (
        ("mine.py:plain", "is not a stage"),
        ("mine.py:none", "has no function 'none'"),
        ("mine.py:computed", "'by_mm' is not written out"),
        ("broken.py:x", "is no Python file"),
        ("pipe.py:x", "is a pipe"),
        ("none.py:x", "No such file"),
    ):
        file, _, name = use.partition(":")
        with pytest.raises(ConfigError, match=problem):
            declared_stage(here / file, name)
