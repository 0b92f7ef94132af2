"""Table 1 on other frames: resampled maps, the plan's commands, and a page from the scores."""

from __future__ import annotations

import csv
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.cli.paper.plan import load_plan
from glsim.denoise.interface import Depth
from glsim.errors import ConfigError, DatasetError
from glsim.eval.paper.experiment_page import (
    EXPERIMENT_FILES,
    FIGURE,
    nlm_over_bilateral,
    read_experiments,
    write_experiments,
)
from glsim.eval.paper.experiments import EXPERIMENTS, data_folder, experiment_folder
from glsim.eval.paper.resampled import resampled, write_resampled
from tests.support.paper_scores import write_scores

#: MSE of the printed order, over a baseline of 100 mm².
ORDERED = {"noisy": 100.0, "adaptive": 100.0, "median": 96.0, "nlm": 80.0, "bilateral": 95.0}


def half_a_map() -> Depth:
    """Depth of 900 mm in the right half, holes in the left one; 32 x 32 px."""
    depth = np.zeros((32, 32), np.float32)
    depth[:, 16:] = 900.0
    return depth


def test_a_loss_of_resolution_spares_flat_surfaces_and_blurs_rims() -> None:
    flat = np.full((32, 32), 900.0, np.float32)
    np.testing.assert_array_equal(resampled(flat, 4), 900)
    for factor in (2, 4):
        noisy = resampled(half_a_map(), factor)
        assert noisy.dtype == np.uint16
        np.testing.assert_array_equal(noisy[:, : 16 - 2 * factor], 0)
        np.testing.assert_array_equal(noisy[:, 16 + 2 * factor :], 900)
        between = (noisy[16] > 0) & (noisy[16] < 900)
        assert 1 <= between.sum() <= 2 * factor  # a ramp over the rim, no wider for a finer map
    narrow = half_a_map()
    narrow[:, 18:] = 0.0  # two columns of surface, between two pixels of the small map
    assert resampled(narrow, 4).max() < 900
    with pytest.raises(ConfigError, match=r"--factor 64: larger than the maps of 32 x 32 px"):
        resampled(flat, 64)


def write_pair(folder: Path, clean: Depth, noisy: Depth) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for layer, depth in (("clean", clean), ("noisy", noisy)):
        cv2.imwrite(str(folder / f"s_00000_{layer}.png"), depth.astype(np.uint16))


def test_pairs_of_a_data_set_lose_their_noise_and_their_resolution(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_pair(tmp_path / "data/p0", half_a_map(), half_a_map() + 7)
    for mask in ("dense", "as-noisy"):
        command = ["paper", "resample", str(tmp_path / "data"), "--factor", "4", "--mask", mask]
        assert main([*command, "-o", str(tmp_path / mask)]) == 0
    assert "wrote 1 pairs" in capsys.readouterr().err
    clean, noisy, masked = (
        cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED)
        for name in (
            "dense/p0/s_00000_clean.png",
            "dense/p0/s_00000_noisy.png",
            "as-noisy/p0/s_00000_clean.png",
        )
    )
    np.testing.assert_array_equal(clean, half_a_map())
    np.testing.assert_array_equal(noisy, resampled(half_a_map(), 4))
    np.testing.assert_array_equal(masked, np.where(noisy > 0, clean, 0))
    before = (tmp_path / "dense/p0/s_00000_noisy.png").stat().st_mtime_ns
    write_resampled(tmp_path / "data", "test", 4, "dense", tmp_path / "dense")
    assert (tmp_path / "dense/p0/s_00000_noisy.png").stat().st_mtime_ns == before
    wrong = ["paper", "resample", str(tmp_path / "data"), "-o", str(tmp_path / "x")]
    assert main([*wrong, "--factor", "1"]) == 2
    assert "--factor 1: give 2 or more" in capsys.readouterr().err
    assert main([*wrong, "--mask", "noisy"]) == 2
    assert "--mask noisy: no such mask (did you mean 'as-noisy'?)" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def write_experiment(root: Path, name: str, seed: int, mse: dict[str, float]) -> None:
    """Write the scores of an experiment in one case, two people with 0.9 and 1.1 of each MSE."""
    folder = experiment_folder(root, name)
    table = write_scores(folder, "dense", seed, "paper", mse)
    with table.with_name("rows.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["subject", "method", "mse_mm2"])
        for method, value in mse.items():
            writer.writerow(["p0", method, 0.9 * value])
            writer.writerow(["p1", method, 1.1 * value])


def test_the_page_says_what_the_scores_say(tmp_path: Path) -> None:
    other = ORDERED | {"bilateral": 79.95, "median": 101.0}
    for seed in (1, 2):
        write_experiment(tmp_path, "perlin", seed, ORDERED)
        write_experiment(tmp_path, "board", seed, other if seed == 2 else ORDERED)
    write_pair(data_folder(tmp_path, "perlin", "dense", 1) / "p0", half_a_map(), half_a_map())
    written = write_experiments(tmp_path)
    assert [path.name for path in written] == [*EXPERIMENT_FILES, FIGURE]
    page = written[0].read_text()
    perlin = EXPERIMENTS["perlin"].title
    assert f"| {perlin} | 100 | 100.0 | 10.0 | 0.960 ± 0.000 | 0.800 ± 0.000 " in page
    assert "| 2 of 2 | 2 of 2 | 2 of 2 |" in page
    board = next(line for line in page.splitlines() if line.startswith("| a board of a face's"))
    assert "| 1 of 2 | 1 of 2 | 2 of 2 |" in board
    assert f"| {perlin} | NLM < Bil < Med < Base |" in page
    # Means over seeds: 80, (95 + 79.95) / 2, (96 + 101) / 2 and 100.
    assert "| a board of a face's size, Perlin noise | NLM < Bil < Med < Base |" in page
    assert f"| {perlin} | 0.842, 0.842 to 0.842 (4 people) |" in page
    assert "| experiment | protocol paper, dense clean maps |" in page
    assert "16.6 %" in page
    assert written[1].read_text().count("data:image/png") == 1
    (one,) = (found for found in read_experiments(tmp_path) if found.name == "board")
    ratio, low, high, people = nlm_over_bilateral(one.folder, one.cases[0])
    assert ratio == pytest.approx(160 / (95 + 79.95))
    assert low <= ratio <= high
    assert people == 4


def test_without_scores_or_with_damaged_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", "experiments", str(tmp_path)]) == 1
    assert "holds no scores of experiments: run glsim paper reproduce" in capsys.readouterr().err
    write_experiment(tmp_path, "wall", 1, ORDERED)
    assert [path.name for path in write_experiments(tmp_path)] == [*EXPERIMENT_FILES]  # no maps
    rows = next(tmp_path.rglob("rows.csv"))
    rows.write_text(rows.read_text().replace("mse_mm2", "mse"))
    with pytest.raises(DatasetError, match=r"rows\.csv: is no table of glsim eval"):
        write_experiments(tmp_path)


def test_the_plan_scores_every_experiment_in_all_cases(tmp_path: Path) -> None:
    plan = load_plan("small")
    assert plan.experiments is not None
    commands = [shlex.join(command) for command in plan.commands(tmp_path)]
    for name, made in EXPERIMENTS.items():
        place = str(experiment_folder(tmp_path, name))
        scored = [line for line in commands if line.startswith("paper tables " + place)]
        assert len(scored) == 4 * len(plan.experiments.seeds)
        makes = "paper resample" if made.factor else "generate"
        assert sum(line.startswith(makes) and place + "/" in line for line in commands) == 2 * len(
            plan.experiments.seeds
        )
    assert commands.count(f"paper experiments {tmp_path}") == 1
    wrong = plan.model_copy(
        update={"experiments": plan.experiments.model_copy(update={"names": ("boards",)})}
    )
    with pytest.raises(ConfigError, match=r"no such experiment 'boards' \(did you mean 'board'"):
        list(wrong.commands(tmp_path))
