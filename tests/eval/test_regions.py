"""Scores per face region agree with plain NumPy, in rows, tables and the report."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.depth_map import central_normals
from glsim.eval.metrics.frame_score import metrics_with_regions, score
from glsim.eval.metrics.regions import Regions
from glsim.eval.metrics.scored_map import Truth, angles_deg
from glsim.eval.report.document import Heading, TextTable
from glsim.eval.report.score_tables import _region_document
from glsim.eval.scoring.aggregate import ScoreSummary
from glsim.measures.stacks import eroded
from glsim.settings.schema import load_settings
from tests.support.eval_scenes import ADVERSARIAL, CAMERA, SIZE
from tests.support.face_models import Board, write_simulated

NUMBERS = {"left": 1, "right": 7, "nowhere": 9}


def halves() -> np.ndarray:  # type: ignore[type-arg]
    labels = np.zeros(SIZE, np.uint8)
    labels[:, : SIZE[1] // 2 - 3], labels[:, SIZE[1] // 2 + 3 :] = 1, 7
    return labels


@pytest.mark.parametrize("name", list(ADVERSARIAL))
def test_parts_are_scored_as_numpy_does(name: str) -> None:
    prediction, clean, seen = ADVERSARIAL[name]
    truth = Truth(clean, seen, CAMERA.rays(), Regions(halves(), NUMBERS))
    found = score(prediction, truth)
    assert {*found, "time_ms"} == set(metrics_with_regions(NUMBERS))
    plain = score(prediction, Truth(clean, seen, CAMERA.rays()))
    for key, value in plain.items():
        np.testing.assert_equal(found[key], value)
    taken = np.where(prediction > 0, prediction, seen).astype(np.float64)
    at = truth.smooth & eroded(prediction > 0, 1)
    for region, number in NUMBERS.items():
        here = halves() == number
        pixels = here & (seen > 0) & truth.parts["interior"]
        error = (taken - clean)[pixels]
        angle = angles_deg(
            *(central_normals(d, truth.rays, at & here) for d in (prediction, clean))
        )
        for column, values in (
            ("rmse_mm", error**2),
            ("bias_mm", error),
            ("normal_mean_deg", angle),
        ):
            value = found[f"{column}@{region}"]
            if not values.size:
                assert math.isnan(value)
            else:
                mean = float(np.mean(values))
                expected = math.sqrt(mean) if column == "rmse_mm" else mean
                assert value == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("regions") / "data"
    output = {"crop": 96, "layers": ["clean", "noisy", "regions"]}
    overrides = {"sensor": "led3d", "split": [0, 0, 1], "output": output}
    settings = load_settings(overrides=overrides, source={"frames_per_subject": 3})
    write_simulated(out, settings, [Board()])
    return out


def test_the_report_has_a_table_a_part(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.eval.report.results.example_frame", lambda job: None)
    out = tmp_path / "o"
    command = ["eval", str(dataset), "-d", "noisy", "-d", "median", "-o", str(out), "-q"]
    assert main([*command, "--workers", "1"]) == 0
    with (out / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["rmse_mm@nose"]) > 1
    assert rows[0]["rmse_mm@nose"] != rows[0]["rmse_mm@tail"]
    with (out / "table.csv").open() as file:
        table = {(row["method"], row["metric"]): row for row in csv.DictReader(file)}
    mean = np.mean([float(row["rmse_mm@nose"]) for row in rows if row["method"] == "median"])
    assert float(table["median", "rmse_mm@nose"]["mean"]) == pytest.approx(mean, rel=1e-6)
    assert "| method | nose | tail |" in (out / "table.md").read_text()
    assert "<h3>rmse_mm [mm] ↓</h3>" in (out / "report.html").read_text()


def test_parts_that_no_frame_shows_are_left_out() -> None:
    summary = ScoreSummary(metrics_with_regions(["nose", "mouth"]))
    row = dict.fromkeys(summary.metrics) | {"subject": "a", "sequence": "s", "frame": 0}
    for method, nose in (("a", 2.0), ("b", 1.5)):
        summary.add(row | {"method": method, "rmse_mm@nose": nose})
    document = _region_document(summary.table())
    heading, table = document.parts[1:]
    assert heading == Heading("rmse_mm [mm] ↓")
    assert table == TextTable(["method", "nose"], [["`a`", "2.00"], ["`b`", "**1.50**"]])
    plain = ScoreSummary()
    plain.add(row | {"method": "a"})
    assert _region_document(plain.table()) is None
