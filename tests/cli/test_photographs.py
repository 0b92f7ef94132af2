"""Networks of photographs on depth: glsim train --photos, then glsim paper photographs."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.eval.paper.photograph_table import fill_holes
from glsim.train.photograph_batches import photograph_batches
from glsim.train.recipe import load_recipe
from tests.support import checkpoint_stand_in
from tests.support.checkpoint_stand_in import write_run
from tests.support.eval_scenes import write_pairs


def test_holes_get_the_depth_of_the_nearest_pixel() -> None:
    depth = np.zeros((5, 7), np.float32)
    depth[2, 1], depth[2, 5] = 800, 900
    filled = fill_holes(depth)
    np.testing.assert_array_equal(filled[:, :3], 800)
    np.testing.assert_array_equal(filled[:, 4:], 900)
    np.testing.assert_array_equal(fill_holes(np.zeros((3, 3), np.float32)), 0)


def run_on(folder: Path, gain: float, seed: int, data: dict[str, Any], left_mm2: float) -> None:
    """Write a run of a network that moves depth towards 900 mm, and what it was trained on."""
    write_run(folder, gain, row="D7", title="DnCNN D7", seed=seed)
    report = json.loads((folder / "run.json").read_text())
    report |= {"data": data, "best": {"monitor": "loss", "value": 1.0, "step": 20}}
    (folder / "run.json").write_text(json.dumps(report))
    table = f"step,validation_mse_mm2\n10,99\n20,{left_mm2}\n"
    (folder / "metrics.csv").write_text(table)


def test_the_table_has_a_row_for_each_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    pairs = write_pairs(tmp_path / "pairs")
    on_photos = {"photographs": 11, "sigma_grey": 25.5, "near_mm": 850.0, "span_mm": 100.0}
    for seed in range(3):
        photos = tmp_path / "photo_runs" / "sigma-25" / f"d7-{seed}"
        run_on(photos, 0.2 + 0.01 * seed, seed, on_photos, 25.0)
        run_on(tmp_path / "runs" / f"d7-{seed}", 0.05, seed, {"manifest_crc32": "x"}, 25.0)
    write_run(tmp_path / "runs" / "unet", 0.2, row="UNet")
    out = tmp_path / "o"
    folders = ["--runs", str(tmp_path / "runs"), "--photo-runs", str(tmp_path / "photo_runs")]
    command = ["paper", "photographs", str(pairs), "-o", str(out), "-q", *folders]
    assert main(command) == 0
    text = (out / "photographs.md").read_text()
    lines = [
        line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| DnCNN")
    ]
    assert [line[1:5] for line in lines] == [
        ["11 photographs, sigma = 25.5 (10.0 mm)", "3", "0.50 ± 0", "as they are"],
        ["11 photographs, sigma = 25.5 (10.0 mm)", "3", "0.50 ± 0", "filled, mask kept"],
        ["our pairs", "3", "-", "as they are"],
        ["our pairs", "3", "-", "filled, mask kept"],
    ]
    assert "UNet" not in text
    with (out / "photographs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 + 2 * 6
    noisy = next(float(row["both_interior_rmse_mm"]) for row in rows if row["network"] == "noisy")
    ours = [float(r["both_interior_rmse_mm"]) for r in rows if r["trained_on"] == "our pairs"]
    # The stand-in keeps holes, so that filling them changes nothing; the ratio is its own.
    assert lines[2][5:] == lines[3][5:]
    assert float(lines[2][-1].split(" ± ")[0]) == pytest.approx(ours[0] / noisy, abs=0.006)

    assert main([*command, "--table", "2"]) == 2
    assert main(["paper", "photographs", str(pairs), "-o", str(out), *folders[2:]]) == 2
    assert main([*command, "--photo-runs", str(tmp_path / "none")]) == 2
    assert "holds no folders of runs" in capsys.readouterr().err


def write_data(folder: Path) -> None:
    """Write frames of three people, one in each split."""
    options = ["--subjects", "3", "--frames-per-subject", "2", "--split", "0.4,0.3,0.3"]
    options += ["--crop", "64", "--workers", "1", "-q"]
    assert main(["generate", "-o", str(folder), *options]) == 0


def test_a_network_is_trained_on_photographs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, photos = tmp_path / "data", tmp_path / "photos"
    write_data(data)
    photos.mkdir()
    rng = np.random.default_rng(0)
    for number in range(3):
        image = rng.integers(0, 256, (80, 96, 3), dtype=np.uint8)
        cv2.imwrite(str(photos / f"{number}.png"), image)
    command = ["train", "paper-d7-small", "--steps", "1", "--set", "training.batch=2",
               "--set", "data.crop=64", "--set", "model.backbone.width=4",
               "--set", "data.validation_frames=2"]  # fmt: skip
    run = tmp_path / "run"
    on_photos = [*command, "--photos", str(photos), "--photo-sigma", "10"]
    assert main([*on_photos, "--data", str(data), "-o", str(run), "-q"]) == 0
    trained_on = json.loads((run / "run.json").read_text())["data"]
    assert trained_on["photographs"] == 3
    assert trained_on["sigma_grey"] == 10
    assert 800 < trained_on["near_mm"] < 900
    assert 50 < trained_on["span_mm"] < 300
    capsys.readouterr()
    assert main([*on_photos, "--simulate", "-o", str(tmp_path / "b")]) == 2
    assert "give --data DIR too" in capsys.readouterr().err
    assert main([*command, "--photo-sigma", "9", "--data", str(data)]) == 2
    assert "give --photos too" in capsys.readouterr().err


def test_grey_levels_are_the_same_depths_for_all_seeds_and_augmentations(tmp_path: Path) -> None:
    data, photos = tmp_path / "data", tmp_path / "photos"
    write_data(data)
    photos.mkdir()
    for number in range(2):
        cv2.imwrite(str(photos / f"{number}.png"), np.full((64, 64), 90 + number, np.uint8))
    spans = set()
    for relief_mm, seed in ((0, 0), (5, 0), (5, 1)):
        recipe = load_recipe("mask-aware-small")
        changed = {"crop": 64, "relief_mm": float(relief_mm)}
        recipe = recipe.model_copy(
            update={"seed": seed, "data": recipe.data.model_copy(update=changed)}
        )
        marks = photograph_batches(str(photos), 10.0, [data], recipe).fingerprint
        spans.add((marks["near_mm"], marks["span_mm"]))
    assert len(spans) == 1


def test_a_network_with_negative_depths_is_listed_and_the_others_are_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    pairs = write_pairs(tmp_path / "pairs")
    on_photos = {"photographs": 11, "sigma_grey": 25.5, "near_mm": 850.0, "span_mm": 100.0}
    place = tmp_path / "photo_runs" / "sigma-25"
    run_on(place / "d7-0", 0.2, 0, on_photos, 25.0)
    run_on(place / "d7-1", -900.0, 1, on_photos, 25.0)  # moves depth far beyond 0
    run_on(tmp_path / "runs" / "d7-0", 0.05, 0, {"manifest_crc32": "x"}, 25.0)
    folders = ["--runs", str(tmp_path / "runs"), "--photo-runs", str(tmp_path / "photo_runs")]
    out = tmp_path / "o"
    assert main(["paper", "photographs", str(pairs), "-o", str(out), "-q", *folders]) == 0
    text = (out / "photographs.md").read_text()
    assert "## Not scored" in text
    assert text.count("- DnCNN D7, seed 1, trained on 11 photographs") == 2
    assert "negative depths in the first of" in text
    assert "seed 0, trained" not in text
    with (out / "photographs.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["trained_on"]]
    lost = {(row["seed"], row["trained_on"]) for row in rows if row["mse_mm2"] == "nan"}
    assert {seed for seed, _ in lost} == {"1"}
    assert len(rows) == 6
