"""Studies of transfer: what is left out, and how a network is compared with filters."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.eval.scoring.statistics import SubjectSums, bootstrap_interval, ratio_interval
from glsim.eval.studies.transfer_report import (
    METRICS,
    NOISY,
    CellResult,
    MethodScores,
    pooled_by_sensor,
    write_transfer,
)
from glsim.eval.studies.transfer_study import Cell, TransferStudy, load_study
from glsim.settings.toml_tables import parse_table, read_toml

TREE: dict[str, Any] = {
    "title": "three sensors",
    "sensor": [
        {"name": "v2", "sensor": "kinect-v2"},
        {"name": "led3d", "train_variants": {"far": {"pose": {"distance_mm": 1200}}}},
        {"name": "any", "sensor": "kinect-v2-fast"},
        {"name": "mine", "sensor": "ideal", "train_people": 0},
    ],
    "source": [{"name": "heads", "kind": "procedural"}, {"name": "bodies", "kind": "people"}],
    "scene": [{"name": "alone"}, {"name": "wall", "settings": {"scene": {"wall_mm": 2000}}}],
}


def study(**tables: Any) -> TransferStudy:
    return parse_table(TransferStudy, TREE | tables, "study")


@pytest.mark.parametrize("size", ["full", "small"])
def test_shipped_studies_can_be_loaded(size: str) -> None:
    """The rigs of any camera stand in train/data/any_camera_*.toml and in the full study."""
    chosen, _ = load_study(size)
    for cell in chosen.cells():
        assert chosen.test_settings(cell).seed == 2000
    (training, *_) = chosen.trainings(["all"], ())
    assert {s.seed for s in chosen.training_settings(training).values()} == {1000}
    if size == "full":
        (any_camera,) = (sensor for sensor in chosen.sensor if sensor.name == "any")
        for side, variant in any_camera.train_variants.items():
            root = Path(__file__).parents[2]
            settings = read_toml(root / "train" / "data" / f"any_camera_{side}.toml")
            assert variant["rig"] == settings["rig"], side


def test_what_is_left_out_is_tested_and_not_trained_on() -> None:
    trainings = study().trainings(["all"], ["any"])
    assert [each.name for each in trainings] == [
        *("without-v2", "without-led3d", "without-any", "without-mine"),
        *("without-heads", "without-bodies", "on-any"),
    ]
    for each in trainings:
        trained = {(sensor.name, face.name) for sensor in each.sensors for face in each.sources}
        tested = {(cell.sensor.name, cell.source.name) for cell in each.cells}
        assert tested
        assert not trained & tested
        assert "mine" not in {sensor.name for sensor in each.sensors}
    assert {cell.sensor.name for cell in trainings[-1].cells} == {"v2", "led3d", "mine"}
    with pytest.raises(ConfigError, match="mine: not in this study"):
        study().trainings([], ["mine"])


def test_data_sets_differ_in_people_and_share_their_poses() -> None:
    chosen = study(test={"settings": {"pose": {"distance_mm": 800}}, "people": 15})
    alone, wall = (chosen.test_settings(cell) for cell in chosen.cells()[:2])
    assert (alone.scene.wall_mm is None, wall.scene.wall_mm is None) == (True, False)
    assert alone.split == (0.0, 0.25, 0.75)
    assert alone.pose.distance_mm.bounds() == (800.0, 800.0)
    assert alone.output.layers == ("clean", "expected", "noisy")
    other = chosen.test_settings(Cell(chosen.sensor[1], chosen.source[0], chosen.scene[0]))
    assert other.model_copy(update={"sensor": alone.sensor}) == alone
    (training,) = chosen.trainings(["source:bodies"], ())
    settings = chosen.training_settings(training)
    names = [place.parts[0] for place in settings]
    assert sorted(names) == sorted(2 * ["v2", "led3d", "led3d-far", "any"])
    far = settings[Path("led3d-far/heads/alone")]
    assert far.pose.distance_mm.bounds() == (1200.0, 1200.0)
    assert (far.seed, far.split[2]) == (1000, 0.0)


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


def test_ratios_that_do_not_exist_are_nan() -> None:
    assert math.isnan(ratio_interval(sums([1.0, 1.0]), sums([0.0, 0.0]))[0])
    ratio, low, high = ratio_interval(sums([2.0]), sums([1.0]))
    assert ratio == 2.0
    assert math.isnan(low)
    assert math.isnan(high)
    nothing = SubjectSums(np.zeros(2), np.zeros(2), np.ones(2))
    assert math.isnan(ratio_interval(nothing, sums([1.0, 1.0]))[0])


def scores(value: float, settings: str = "") -> MethodScores:
    """Scores of eight people with this mean in each metric, and half of it as bias at 900 mm."""
    rows = {f"p{n}": np.array([[2 * value * (1 + n / 100), 2, 2]]) for n in range(8)}
    bias = {name: {"900": [value / 2 * 3000, 3000.0]} for name in rows}
    people = {name: row.repeat(len(METRICS), axis=0) for name, row in rows.items()}
    return MethodScores(settings, people, bias)


def result(network: float, noisy: float = 4.0, source: int = 0, scene: int = 0) -> CellResult:
    methods = {
        NOISY: scores(noisy),
        "guided": scores(2.0, "guided:radius=2"),
        "plane": scores(3.0),
        "net": scores(network),
    }
    tree = study()
    return CellResult("net", Cell(tree.sensor[0], tree.source[source], tree.scene[scene]), methods)


def test_a_network_is_compared_with_the_best_filter_and_the_input() -> None:
    row = result(1.8).row("flips_px")
    assert (row["filter"], row["settings"], row["people"]) == ("guided", "guided:radius=2", 8)
    assert (row["to_filter"], row["to_input"]) == pytest.approx((0.9, 0.45))
    assert math.isnan(result(1.8, noisy=0.0).row("flips_px")["to_input"])


def test_pooling_joins_scenes_of_the_same_people_and_people_of_other_faces() -> None:
    (same,) = pooled_by_sensor([result(1.0), result(3.0, scene=1)])
    net = same.scores["net"]
    assert net.values("flips_px").frames.tolist() == [4.0] * 8
    assert net.mean("flips_px") == pytest.approx(2.0 * 1.035)
    assert net.bias["heads/p0"]["900"] == [6000.0, 6000.0]
    (other,) = pooled_by_sensor([result(1.0), result(3.0, source=1)])
    assert len(other.scores["net"].people) == 16


def test_the_files_of_the_results(tmp_path: Path) -> None:
    results = [result(1.8), result(2.4, noisy=0.0, scene=1)]
    paths = write_transfer(study(), results, ["how it was made"], tmp_path)
    assert [path.name for path in paths] == ["transfer.md", "transfer.csv"]
    text = paths[0].read_text()
    assert "- how it was made" in text
    line = "| net | `v2` | heads | wall | 0 | guided | 2.07 | 2.48 | 1.20 [1.20, 1.20] | n/a |"
    assert line in text
    assert "| net | `v2` | 1.05 [1.05, 1.05] |" in text
    assert text.splitlines()[-1].count("|") == 11
    assert "| 1.05 |" in text  # the largest bias
