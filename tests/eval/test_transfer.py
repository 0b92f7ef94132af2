"""``glsim.eval.transfer``: what is left out, and how a network is compared with filters."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.errors import ConfigError
from glsim.eval.report.figures.ratio_dots import RatioDot, ratio_dots
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval, ratio_interval
from glsim.eval.transfer.cases import find_cases
from glsim.eval.transfer.cells import FILTERS, METRICS, NOISY, CellScores, MethodScores, pool
from glsim.eval.transfer.comparison import (
    FIGURES,
    CellResult,
    NetworkComparison,
    compare,
    compare_bias,
    pool_by_sensor,
)
from glsim.eval.transfer.report import write_results
from glsim.eval.transfer.study import Goals, SensorFamily, TransferStudy
from glsim.settings.tables import parse_table, read_toml

TREE: dict[str, Any] = {
    "title": "three sensors",
    "sensor": [
        {"name": "v2", "sensor": "kinect-v2", "tof": True},
        {"name": "led3d", "train_variants": {"far": {"pose": {"distance_mm": 1200}}}},
        {"name": "any", "sensor": "kinect-v2-fast"},
        {"name": "mine", "sensor": "ideal", "train_people": 0},
    ],
    "source": [{"name": "heads", "kind": "procedural"}, {"name": "bodies", "kind": "people"}],
    "scene": [{"name": "alone"}, {"name": "wall", "settings": {"scene": {"wall_mm": 2000}}}],
}


def test_the_shipped_study_trains_on_the_rigs_of_any_camera() -> None:
    """Both write them down: train/data/any_camera_*.toml, and the variants of the study."""
    root = Path(__file__).parents[2]
    study_file = read_toml(root / "glsim" / "cli" / "transfers" / "full.toml")
    (any_camera,) = (sensor for sensor in study_file["sensor"] if sensor["name"] == "any")
    for size, variant in any_camera["train_variants"].items():
        settings = read_toml(root / "train" / "data" / f"any_camera_{size}.toml")
        assert variant["rig"] == settings["rig"], size


def study(**tables: Any) -> TransferStudy:
    return parse_table(TransferStudy, TREE | tables, "study")


def outline(*leave: str, train_on: tuple[str, ...] = (), given: bool = False) -> list[Any]:
    """Cases as (title, tested sensors, tested faces, name of the training)."""
    cases = find_cases(study(), leave, train_on, given=given)
    return [
        (
            case.title,
            [sensor.name for sensor in case.sensors],
            [source.name for source in case.sources],
            case.training and case.training.name,
        )
        for case in cases
    ]


EVERY = ["v2", "led3d", "any", "mine"]
BOTH = ["heads", "bodies"]


def test_what_is_left_out_is_tested_and_not_trained_on() -> None:
    assert outline("sensor:v2") == [("sensor v2", ["v2"], BOTH, "without-v2_all-faces")]
    assert outline("source:heads") == [("source heads", EVERY, ["heads"], "all-sensors_bodies")]
    for case in find_cases(study(), ["all"]):
        assert case.training is not None
        trained = {
            (sensor.name, source.name)
            for sensor in case.training.sensors
            for source in case.training.sources
        }
        assert not trained & {(sensor.name, source.name) for sensor, source in case.cells}
    assert [row[0] for row in outline("all")] == [row[0] for row in outline()]
    assert [row[0] for row in outline()] == [
        *(f"sensor {name}" for name in EVERY),
        *(f"source {name}" for name in BOTH),
    ]


def test_a_sensor_that_is_only_tested_is_in_no_training() -> None:
    assert outline("sensor:mine")[0][3] == "all-sensors_all-faces"
    for case in find_cases(study()):
        assert case.training is not None
        assert "mine" not in {sensor.name for sensor in case.training.sensors}
    with pytest.raises(ConfigError, match="only tested"):
        find_cases(study(), train_on=["mine"])


def test_one_training_on_chosen_sensors_leaves_out_all_others() -> None:
    cases = outline(train_on=("any",))
    assert [row[:2] for row in cases] == [
        (f"sensor {name}", [name]) for name in EVERY if name != "any"
    ]
    assert {row[3] for row in cases} == {"any_all-faces"}
    both = outline("source:heads", train_on=("any",))
    assert both == [("source heads", ["v2", "led3d", "mine"], ["heads"], "any_bodies")]


def test_given_networks_are_scored_on_all_cells_or_on_chosen_ones() -> None:
    assert outline(given=True) == [("-", EVERY, BOTH, None)]
    assert outline("source:heads", given=True) == [("source heads", EVERY, ["heads"], None)]
    alone = study(sensor=TREE["sensor"][:1], source=TREE["source"][:1])
    with pytest.raises(ConfigError, match="nothing can be left out"):
        find_cases(alone)
    assert len(find_cases(alone, given=True)) == 1


def test_data_sets_differ_in_people_and_share_their_poses() -> None:
    chosen = study(test={"settings": {"pose": {"distance_mm": 800}}, "people": 15})
    v2, led3d = chosen.sensor[:2]
    heads = chosen.source[0]
    test = [chosen.settings_of(data) for data in chosen.test_sets(v2, heads)]
    assert [settings.scene.wall_mm is None for settings in test] == [True, False]
    assert {settings.split for settings in test} == {(0.0, 0.25, 0.75)}
    assert {settings.pose.distance_mm.bounds() for settings in test} == {(800.0, 800.0)}
    assert test[0].output.layers == ("clean", "expected", "noisy")
    other = chosen.settings_of(chosen.test_sets(led3d, heads)[0])
    assert other.model_copy(update={"sensor": test[0].sensor}) == test[0]
    train = chosen.training_sets(led3d, heads)
    assert [data.place.parts[2] for data in train] == ["led3d", "led3d", "led3d-far", "led3d-far"]
    settings = [chosen.settings_of(data) for data in train]
    assert {s.seed for s in settings}.isdisjoint({s.seed for s in test})
    assert settings[2].pose.distance_mm.bounds() == (1200.0, 1200.0)
    assert chosen.settings_of(chosen.training_sets(v2, heads)[0]).split[2] == 0.0


def sums(values: list[float], frames: int = 2) -> SubjectSums:
    counts = np.full(len(values), float(frames))
    return SubjectSums(np.array(values) * frames, counts, counts)


def test_the_interval_of_a_ratio_is_over_the_same_people() -> None:
    """People differ by a factor of ten, methods by 20 % on each: the ratio is sure."""
    people = np.linspace(1.0, 10.0, 12)
    ratio, low, high = ratio_interval(sums(list(0.8 * people)), sums(list(people)))
    assert (ratio, low, high) == pytest.approx((0.8, 0.8, 0.8))
    noise = np.random.default_rng(1).normal(1.0, 0.1, 12)
    ratio, low, high = ratio_interval(sums(list(0.8 * people * noise)), sums(list(people)))
    assert low < ratio < high
    alone = bootstrap_interval(sums(list(people)))
    assert high - low < (alone[1] - alone[0]) / sums(list(people)).mean
    assert ratio_interval(sums([1.0, 3.0]), sums([1.0, 1.0]))[0] == 2.0


def test_ratios_that_do_not_exist_are_nan() -> None:
    assert math.isnan(ratio_interval(sums([1.0, 1.0]), sums([0.0, 0.0]))[0])
    ratio, low, high = ratio_interval(sums([2.0]), sums([1.0]))
    assert ratio == 2.0
    assert math.isnan(low)
    assert math.isnan(high)
    nothing = SubjectSums(np.zeros(2), np.zeros(2), np.ones(2))
    assert math.isnan(ratio_interval(nothing, sums([1.0, 1.0]))[0])
    # Only some draws have an error at all.
    ratio, low, high = ratio_interval(sums([1.0, 1.0, 1.0]), sums([0.0, 0.0, 3.0]))
    assert low <= ratio == 1.0 <= high


def scores(name: str, value: float, people: int = 8, settings: str = "") -> MethodScores:
    """Scores of a method that has this mean in each metric, and half of it as bias at 900 mm."""
    table = {f"p{n}": (2 * value * (1 + n / 100), 2.0, 2.0) for n in range(people)}
    bias = {f"p{n}": {"900": [value / 2 * 3000, 3000.0]} for n in range(people)}
    return MethodScores(name, [settings] if settings else [], dict.fromkeys(METRICS, table), bias)


def result(
    network: float, best: float = 2.0, noisy: float = 4.0, *, tof: bool = True, scene: str = "alone"
) -> CellResult:
    methods = [scores(NOISY, noisy), scores("guided", best, settings="guided:radius=2"),
               scores("plane", 1.5 * best), scores("net", network)]  # fmt: skip
    cell = CellScores({method.name: method for method in methods})
    return CellResult("net", "-", SensorFamily(name="v2", tof=tof), "heads", scene, cell)


def verdicts(rows: list[NetworkComparison]) -> list[str]:
    return [row.verdict_text.strip("*") for row in rows]


def test_the_goal_depends_on_the_sensor_and_the_figure() -> None:
    assert "guided" in FILTERS
    assert "plane, mask cleaned" in FILTERS
    rows = compare([result(1.8)], Goals())
    assert [row.filter for row in rows] == ["guided"] * 4
    assert [row.settings for row in rows] == [("guided:radius=2",)] * 4
    assert [row.to_filter.value for row in rows] == pytest.approx([0.9] * 4)
    assert [row.to_input.value for row in rows] == pytest.approx([0.45] * 4)
    assert [row.goal for row in rows] == [0.85, 0.85, 1.0, 0.5]
    assert verdicts(rows) == ["fail", "fail", "pass", "pass"]
    assert verdicts(compare([result(1.8, tof=False)], Goals())) == ["pass"] * 4
    assert verdicts(compare([result(2.5, tof=False)], Goals())) == [
        "fail",
        "fail",
        "pass",
        "fail",
    ]
    at_goal = compare([result(1.7)], Goals(tof_ratio=0.85 + 1e-9))
    assert verdicts(at_goal)[0] in ("pass", "pass?")


def test_a_network_that_errs_where_the_input_does_not_fails() -> None:
    rows = compare([result(1.0, noisy=0.0)], Goals())
    assert verdicts(rows)[2:] == ["fail", "fail"]
    assert math.isnan(rows[2].to_input.value)
    assert verdicts(compare([result(0.0, noisy=0.0)], Goals()))[2:] == ["pass", "pass"]
    undefined = result(1.0)
    empty = {f"p{n}": (0.0, 0.0, 2.0) for n in range(8)}
    undefined.scores.methods["net"].sums["normal_mean_deg"] = empty
    assert verdicts(compare([undefined], Goals()))[1] == "n/a"


def test_pooling_joins_scenes_of_the_same_people_and_people_of_other_faces() -> None:
    near, far = result(1.0).scores, result(3.0, scene="wall").scores
    same = pool([("heads", near), ("heads", far)]).methods["net"]
    assert len(same.people) == 8
    assert same.values(METRICS[0]).frames.tolist() == [4.0] * 8
    assert same.mean(METRICS[0]) == pytest.approx(
        (near.methods["net"].mean(METRICS[0]) + far.methods["net"].mean(METRICS[0])) / 2
    )
    other = pool([("heads", near), ("ict", far)])
    assert len(other.methods["net"].people) == 16
    assert other.methods["guided"].settings == ["guided:radius=2"]
    assert other.methods["net"].bias["heads/p0"]["900"] == [1500.0, 3000.0]
    assert same.bias["heads/p0"]["900"] == [6000.0, 6000.0]


def test_bias_over_distance_is_that_of_the_pooled_cells() -> None:
    (bias,) = compare_bias(pool_by_sensor([result(1.0), result(0.2, scene="wall")]))
    assert bias.filter == "guided"
    assert bias.largest_mm == pytest.approx(0.3)
    assert bias.input_there_mm == pytest.approx(bias.bins["noisy"][0].mean_mm)
    assert [b.from_mm for b in bias.bins["noisy"]] == [900]


def test_the_files_of_the_results(tmp_path: Path) -> None:
    results = [result(1.8), result(2.4, noisy=0.0, scene="wall")]
    paths = write_results(study(), results, ["how it was made"], tmp_path)
    assert [path.name for path in paths] == [f"transfer.{s}" for s in ("md", "csv", "json", "png")]
    text = paths[0].read_text()
    assert "- how it was made" in text
    assert "| `v2` | heads | wall | 0 | guided | 2.07 | 2.48 | 1.20 [1.20, 1.20] | n/a |" in text
    assert "network | left out" not in text  # the same in all rows
    assert "| `v2` | guided | 1.00 | +1.00 |" in text
    assert re.search(r"\| \d\.\d\d \(input \d\.\d\d\) (pass|\*\*fail\*\*) \|", text)
    tree = json.loads(paths[2].read_text())
    assert [row["scene"] for row in tree["cells"]] == ["alone", "wall"] * len(FIGURES)
    assert tree["cells"][-1]["to_input"] is None
    before = [path.read_bytes() for path in paths]
    write_results(study(), results, ["how it was made"], tmp_path)
    assert before == [path.read_bytes() for path in paths]


def test_dots_lie_where_their_ratios_are() -> None:
    dots = [
        RatioDot("v2", "heads", False, 0.8, 0.7, 0.9, 0.85),
        RatioDot("v2", "heads", True, 90.0, 40.0, 200.0, 0.85),
        RatioDot("led3d", "ict", False, math.nan, math.nan, math.nan),
    ]
    figure = ratio_dots([("interior", dots), ("flips", dots[:1])], ("alone", "wall"))
    left, right = figure.axes
    drawn = [line.get_xdata()[0] for line in left.lines if line.get_marker() == "o"]
    assert drawn == [0.8, 25.0]
    assert left.get_xlim()[0] < 0.7 < 1.0 < left.get_xlim()[1]
    assert [tick.get_text() for tick in left.get_yticklabels()] == ["v2", "led3d"]
    assert left.get_ylim()[0] > left.get_ylim()[1]
    assert right.get_xscale() == "log"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["heads", "ict", "alone", "wall", "goal"]
