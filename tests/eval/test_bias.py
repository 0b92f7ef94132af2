"""Bias over distance, and the choice of the truth: bins, intervals, tables, cached blocks."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import DatasetError
from glsim.eval.metrics.scored_map import Truth
from glsim.eval.scoring.bias import (
    ENOUGH_PIXELS,
    BiasSums,
    add_bias,
    bias_bins,
    bias_by_distance,
    largest_bias,
)
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import evaluate
from tests.support.dataset_fakes import make, make_settings, make_tasks

SIDE = 60


def ramp(near_mm: float = 550.0, far_mm: float = 1350.0) -> np.ndarray:  # type: ignore[type-arg]
    """A wall that recedes to the right, more slowly than a jump."""
    return np.linspace(near_mm, far_mm, SIDE, dtype=np.float32)[None, :] * np.ones((SIDE, 1), "f4")


def truth_of(clean: np.ndarray) -> Truth:  # type: ignore[type-arg]
    return Truth(clean, clean, np.zeros((*clean.shape, 2), np.float32))


def write_walls(folder: Path, people: int = 3) -> Path:
    """Walls whose input is 2 mm too far below 1 m and 1 mm too near beyond; expected: + 2 mm."""
    for person in range(people):
        place = folder / f"p{person}"
        place.mkdir(parents=True)
        for number in range(2):
            clean = np.rint(ramp(550 + person, 1350 + person))
            noisy = np.where(clean < 1000, clean + 2, clean - 1)
            for layer, depth in (("clean", clean), ("noisy", noisy), ("expected", clean + 2)):
                cv2.imwrite(str(place / f"s_{number:03d}_{layer}.png"), depth.astype(np.uint16))
    return folder


def test_a_bin_holds_the_mean_error_of_its_pixels() -> None:
    clean = ramp()
    bins = bias_bins(np.where(clean < 1000, clean + 2, clean - 1), truth_of(clean))
    assert list(bins) == [str(edge) for edge in range(500, 1400, 100)]
    assert sum(pixels for _, pixels in bins.values()) == SIDE * SIDE
    for edge, (error, pixels) in bins.items():
        assert error / pixels == pytest.approx(2.0 if int(edge) < 1000 else -1.0, abs=1e-3)


def test_holes_edges_and_flying_pixels_have_no_bias() -> None:
    clean = ramp()
    clean[:, :10] = 0.0  # with its band of 3 px
    depth = np.where(clean > 0, clean + 1, 0)
    depth[5], depth[6] = 0.0, clean[6] + 60
    truth = truth_of(clean)
    truth.input_valid[7] = False
    bins = bias_bins(depth, truth)
    assert sum(pixels for _, pixels in bins.values()) == (SIDE - 3) * (SIDE - 13)
    assert all(error == pytest.approx(pixels, rel=1e-3) for error, pixels in bins.values())


def test_the_interval_is_over_people_and_small_bins_do_not_count() -> None:
    rng = np.random.default_rng(0)
    total: BiasSums = {}
    own_mm = rng.normal(0.5, 0.2, 40)
    for person, bias_mm in enumerate(own_mm):
        for _ in range(2):
            add_bias(total, "m", f"p{person}", {"900": [bias_mm * 200, 200], "1000": [90.0, 10]})
    near, far = bias_by_distance(total["m"])
    assert (near.from_mm, near.pixels, near.subjects) == (900, 16_000, 40)
    assert near.mean_mm == pytest.approx(own_mm.mean())
    half = 1.96 * own_mm.std() / np.sqrt(40)
    assert near.high_mm - near.low_mm == pytest.approx(2 * half, rel=0.15)
    assert (far.mean_mm, far.pixels) == (9.0, 800)
    assert near.pixels > ENOUGH_PIXELS > far.pixels
    assert largest_bias([near, far]) == near
    assert largest_bias([far]) is None


def test_the_tables_and_the_csv_file_hold_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.eval.scoring.bias.ENOUGH_PIXELS", 1000)
    pairs = write_walls(tmp_path / "pairs")
    command = ["eval", str(pairs), "-d", "noisy", "-d", "median", "--workers", "1", "-q"]
    assert main([*command, "--no-figures", "-o", str(tmp_path / "o")]) == 0
    text = (tmp_path / "o" / "table.md").read_text()
    own = text[text.index("## Bias over distance [mm]") :]
    noisy = next(line for line in own.splitlines() if line.startswith("| `noisy`"))
    assert noisy.startswith("| `noisy` | 2.00 | +2.00 |")
    assert "-1.00" in noisy
    with (tmp_path / "o" / "bias_by_distance.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == "noisy"]
    assert (rows[1]["from_mm"], float(rows[1]["bias_mm"])) == ("600", 2.0)
    assert rows[0]["subjects"] == "3"


def test_another_truth_is_another_score_and_not_a_cached_one(tmp_path: Path) -> None:
    pairs = write_walls(tmp_path / "pairs")
    biases = {}
    for truth in ("clean", "expected", "clean"):
        job = ScoringJob(pairs, "test", ("noisy",), truth=truth)  # type: ignore[arg-type]
        found = evaluate(job, tmp_path / "o", workers=1)
        biases[truth] = {b.from_mm: b.mean_mm for b in found.summary.bias_by_distance("noisy")}
    assert biases["clean"][700] == pytest.approx(2.0)
    assert biases["expected"][700] == pytest.approx(0.0)
    assert biases["expected"][1200] == pytest.approx(-3.0)
    assert len([p for p in (tmp_path / "o" / ".blocks").iterdir() if p.is_dir()]) == 2


def test_a_data_sets_truth_may_be_the_expected_depth(tmp_path: Path) -> None:
    layers = ["clean", "expected", "noisy"]
    make(tmp_path / "d", make_settings(layers=layers, depth_unit_mm=0.1), make_tasks(8, 2))
    make(tmp_path / "plain", tasks=make_tasks(8, 2))
    scores = {}
    for truth in ("clean", "expected"):
        job = ScoringJob(tmp_path / "d", "test", ("noisy",), truth=truth)  # type: ignore[arg-type]
        found = evaluate(job, tmp_path / truth, workers=1)
        scores[truth] = found.summary.mean("noisy", "both_bias_mm")
    # The fake's expected depth is 2 mm beyond the clean one.
    assert scores["clean"] - scores["expected"] == pytest.approx(2.0, abs=0.02)
    with pytest.raises(DatasetError, match=r"output\.layers=clean,expected,noisy"):
        ScoringJob(tmp_path / "plain", "test", (), truth="expected").frames()
