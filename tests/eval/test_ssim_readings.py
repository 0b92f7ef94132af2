"""Readings of the paper's SSIM: values by hand, scikit-image, and what the page concludes."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from glsim.cli import main
from glsim.denoise.frames import Frames
from glsim.eval.paper.printed_values import PRINTED_FILTERS
from glsim.eval.paper.runs import row_networks
from glsim.eval.paper.ssim_page import largest_difference, ssim_document
from glsim.eval.paper.ssim_readings import (
    AS_PRINTED,
    COLUMNS,
    NLM_8_BIT,
    READINGS,
    Reading,
    ReadingScores,
    found_range,
    measure_readings,
    of_own_maximum,
    one_window,
    printed_formula,
    reading_of_type,
    saturated,
    wrapped,
)
from glsim.eval.scoring.pairs import open_frames
from tests.support import checkpoint_stand_in
from tests.support.checkpoint_stand_in import write_run
from tests.support.eval_scenes import dome, noisy, write_pairs
from tests.support.moved_sets import write_domes


def constant(value: float) -> np.ndarray:  # type: ignore[type-arg]
    return np.full((9, 9), value, np.float32)


def test_conversions_to_8_bits() -> None:
    depth = np.array([[0, 1, 255, 256, 900.4]], np.float32)
    assert saturated(depth).tolist() == [[0, 1, 255, 255, 255]]
    assert wrapped(depth).tolist() == [[0, 1, 255, 0, 900 - 768]]
    assert of_own_maximum(depth).tolist() == [[0, 0, 72, 73, 255]]
    assert of_own_maximum(constant(0)).max() == 0


def test_constant_images_by_hand() -> None:
    """Without variance the second factor is C2 / C2, and C2 / C1 in the printed formula."""
    x, y, length = 100.0, 110.0, 8000.0
    c1, c2 = (0.001 * length) ** 2, (0.003 * length) ** 2
    means = (2 * x * y + c1) / (x * x + y * y + c1)
    first, second = constant(x), constant(y)
    assert one_window(first, second, length, AS_PRINTED) == pytest.approx(means, rel=1e-9)
    assert printed_formula(first, second, length, AS_PRINTED) == pytest.approx(means * c2 / c1)


def test_the_printed_formula_is_above_1_for_equal_images() -> None:
    """Nine times the constant above the line: the paper cannot have computed what it prints."""
    clean = dome()
    assert printed_formula(clean, clean, 8000.0, AS_PRINTED) > 1.1


def test_one_window_by_hand() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 100, (2, 8, 8))
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    covariance = np.cov(x.ravel(), y.ravel(), bias=True)
    wanted = (2 * x.mean() * y.mean() + c1) * (2 * covariance[0, 1] + c2)
    wanted /= (x.mean() ** 2 + y.mean() ** 2 + c1) * (np.trace(covariance) + c2)
    assert one_window(x, y, 255.0, (0.01, 0.03)) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("data", "kind"), [("uint16 mm", np.uint16), ("uint8, saturated", np.uint8)]
)
def test_scikit_image_takes_l_from_the_type(data: str, kind: type) -> None:
    clean, seen = dome() - 890 * (dome() > 0), noisy(dome())
    seen = np.where(seen > 0, np.clip(seen - 890, 1, 255), 0).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a type's range should be stated
        wanted = structural_similarity(seen.astype(kind), clean.astype(kind))
    assert reading_of_type(data).of(seen, clean) == pytest.approx(wanted, rel=1e-9)
    with pytest.raises(ValueError, match="floating point"):  # L = 2 until version 0.20
        structural_similarity(seen, clean)


def test_the_range_found_is_that_of_both_images() -> None:
    assert found_range(constant(900) * np.eye(9), constant(1)) == 900
    assert found_range(constant(5), constant(5)) == 1


def test_readings_have_names_of_their_own_and_equal_images_have_1() -> None:
    names = [reading.name for reading in READINGS]
    assert len(set(names)) == len(names) > 20
    for reading in READINGS:
        if reading.program != "printed formula":
            assert reading.of(dome(), dome()) == pytest.approx(1.0), reading.name


def scores(values: dict[str, float]) -> ReadingScores:
    """Scores with one value for every reading but the printed ones for uint16."""
    table = {reading.name: dict.fromkeys(COLUMNS, 0.5) for reading in READINGS}
    table[reading_of_type("uint16 mm").name] = values
    return ReadingScores(3, table, dict.fromkeys(COLUMNS, 1.0), 0.0)


def test_the_page_concludes_from_the_numbers() -> None:
    printed = {column: PRINTED_FILTERS[column].ssim for column in COLUMNS}
    assert largest_difference(printed) == 0
    text = ssim_document({"made up": scores(printed)}).markdown()
    assert "One reading gives the column: the nearest is uint16 mm" in text
    off = scores(printed | {"nlm": 0.5})
    text = ssim_document({"made up": off}).markdown()
    assert "No reading gives the column" in text
    assert "whose largest difference is 0.337" in text
    assert "no nearer than any single reading" in text


def test_the_study_of_a_data_set(tmp_path: Path) -> None:
    data = write_domes(tmp_path / "d", "depth")
    found = measure_readings(open_frames(data, "test", protocol="paper"), limit=1)
    assert found.frames == 1
    assert NLM_8_BIT in found.mse_mm2
    assert found.ours_off < 1e-9
    assert main(["paper", "ssim", str(data), "-o", str(tmp_path / "o"), "-q"]) == 0
    text = (tmp_path / "o" / "ssim_readings.md").read_text()
    assert "Protocol paper" in text
    assert "Protocol depth" in text
    assert "in 8 bits" in text


def test_networks_have_columns_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each value is that of its reading; nearest first; no row is invented."""
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    pairs = write_pairs(tmp_path / "pairs", 2, 1)
    write_run(tmp_path / "runs/d7", 0.5, row="D7")
    write_run(tmp_path / "runs/ours", 0.2, row=None, title="ours", soft=True)
    out = tmp_path / "o"
    command = ["paper", "ssim", str(pairs), "--runs", str(tmp_path / "runs"), "-o", str(out)]
    assert main([*command, "-q"]) == 0
    page = (out / "ssim_readings.md").read_text()
    assert "| reading | D7 | AR D7 | largest difference |" in page
    assert "printed PSNR D7 32.97, AR D7 33.39 dB" in page
    networks = row_networks(tmp_path / "runs")
    assert {*networks} == {"D7", "AR D7"}
    frames = open_frames(pairs, "test", protocol="depth")
    scores = measure_readings(frames, networks=networks)
    sample = frames.load(0)
    reading = reading_of_type("uint16 mm")
    moved = np.where(sample.noisy_mm > 0, 0.5 * (sample.noisy_mm + 900), 0).astype(np.float32)
    first = reading.of(moved, sample.clean_mm)
    wanted = (first + _second(frames, reading)) / 2 if len(frames) == 2 else first
    assert scores.ssim[reading.name]["D7"] == pytest.approx(wanted)
    off = [
        float(line.split("|")[-2])
        for line in page[page.index("| reading | D7 |") :].splitlines()[3 : 3 + len(READINGS)]
    ]
    assert off == sorted(off)
    assert len(off) == len(READINGS)


def _second(frames: Frames, reading: Reading) -> float:
    sample = frames.load(1)
    moved = np.where(sample.noisy_mm > 0, 0.5 * (sample.noisy_mm + 900), 0).astype(np.float32)
    return reading.of(moved, sample.clean_mm)
