"""The 39 printed values beside ours: the rules of verdicts, what chance gives, and the page."""

import math
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import DatasetError
from glsim.eval.metrics.scored_map import psnr_db
from glsim.eval.paper.ours_beside_printed import (
    JUDGED,
    Case,
    printed_values,
    read_case,
    verdict,
    write_values,
)
from glsim.eval.paper.paper_tables import PAPER_ROWS
from glsim.eval.paper.printed_values import COPIES, PRINTED_FILTERS, PRINTED_NETWORKS, VERDICTS
from tests.support import checkpoint_stand_in
from tests.support.paper_scores import write_filters, write_networks, write_table

PRINTED_MSE = {name: row.mse_mm2 for name, row in PRINTED_FILTERS.items()}


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)


def judged(folder: Path) -> dict[tuple[str, str], str]:
    case = read_case(folder, *JUDGED)
    return {
        (row.title, metric): verdict(row.title, metric, value, case)[0]
        for _, row, metric, value in printed_values()
    }


def test_printed_values_agree_with_each_other() -> None:
    """A mean of PSNRs is above the PSNR of the mean, here by 1.3 dB at most: typing errors show."""
    for row in (*PRINTED_FILTERS.values(), *PRINTED_NETWORKS.values()):
        assert 0 < row.psnr_db - psnr_db(row.mse_mm2) < 1.3, row.title
        assert 0.77 <= row.ssim <= 0.9986
    rows = {row for table in (2, 3) for row in PAPER_ROWS[table]}
    assert set(PRINTED_NETWORKS) == rows
    assert [sum(v[0] == table for v in printed_values()) for table in (1, 2, 3)] == [15, 6, 18]


def test_each_verdict_has_its_rule(tmp_path: Path) -> None:
    assert {*judged(tmp_path).values()} == {"not scored", "copy", "baseline"}
    far = {name: value / 4 for name, value in PRINTED_MSE.items()}
    far |= {"bilateral": far["noisy"] * 1.2, "nlm": PRINTED_MSE["nlm"]}
    for seed, factor in enumerate((1.0, 1.01, 0.99), 1):
        assert seed == 1 or judged(tmp_path)["Median", "mse_mm2"] == "too few seeds"
        mse = {name: value * factor for name, value in far.items()}
        mse["median"] *= 1 + 0.001 * factor
        write_filters(tmp_path, "dense", seed, "paper", mse)
    found = judged(tmp_path)
    assert found["NLM", "mse_mm2"] == "inside the spread"
    assert found["Median", "mse_mm2"] == "same side"
    assert found["Median", "ssim_16bit"] == "not told apart"  # printed equal to the noisy input
    assert found["Bilateral", "mse_mm2"] == "other side"
    assert found["NLM", "ssim_16bit"] == "other size"  # 1 - SSIM: 116 times the noisy input's
    assert {found[row, "mse_mm2"] for row in COPIES} == {"copy"}
    assert found["Baseline", "mse_mm2"] == "baseline"
    d20 = [1800.0, 1900.0, 1950.0]
    write_networks(tmp_path, 1000.0, {"D7": [900.0, 1100.0, 1020.0], "D20": d20})
    write_networks(tmp_path / "steps", 1000.0, {"D20": d20}, ended="steps")
    assert judged(tmp_path)["D7", "mse_mm2"] == "not told apart"
    assert judged(tmp_path)["D20", "mse_mm2"] == "other size"
    assert judged(tmp_path / "steps")["D20", "mse_mm2"] == "not trained"
    assert {*VERDICTS} >= {*found.values()}


def test_scores_without_relation_get_no_more_than_chance() -> None:
    """Random scores in the printed range: the page's expectation holds, and few are inside."""
    rng, counts, expected = np.random.default_rng(3), Counter[str](), 0.0
    for _ in range(400):
        mse = np.exp(rng.uniform(np.log(1147), np.log(80018)) + 0.02 * rng.standard_normal(3))
        scores = [({"mse_mm2": value}, {"mse_mm2": 9600.0}) for value in mse.tolist()]
        case = Case({"NLM": scores, "UNet": scores})
        for _, row, metric, printed in printed_values():
            if row.title in case.seeds and metric == "mse_mm2":
                found, chance = verdict(row.title, metric, printed, case)
                counts[found] += 1
                expected += chance
    assert counts["inside the spread"] == pytest.approx(expected, abs=4 * math.sqrt(expected))
    assert expected < 0.05 * counts.total()
    assert counts["same side"] < 0.6 * (counts["same side"] + counts["other side"])


def test_the_page_has_every_value_and_what_chance_gives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed, factor in ((1, 0.9), (2, 1.1), (3, 1.0)):
        mse = {name: value * factor for name, value in PRINTED_MSE.items()}
        write_filters(tmp_path, "dense", seed, "paper", mse)
    write_table(tmp_path / "filters/dense/1/paper/baselines.csv", {"zero image": 2650.0})
    write_networks(tmp_path, 1000.0, {"D7": [700.0], "UNet": [1500.0]}, ended="steps")
    assert main(["paper", "values", str(tmp_path)]) == 0
    page = (tmp_path / "paper_values.md").read_text()
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    rows = {tuple(cells[1:3]): cells for cells in lines if len(cells) == 6}
    assert len([1 for cells in rows.values() if cells[0] in "123"]) == 39
    assert rows["Median", "MSE"][3:] == ["1361", "1361 ± 136.1", "**inside the spread**"]
    training = "small, seeds: 1, 10 steps, 1.5 min each, still falling"
    assert rows[f"UNet ({training})", "MSE"][4:] == ["1500", "**not trained**"]
    assert rows["AR D7", "MSE"][4:] == ["700.0", "**copy of D7**"]
    assert rows["zero image", "MSE"][4] == "2650"
    inside = next(cells for cells in lines if cells[0] == "inside the spread")
    assert int(inside[1]) > float(inside[2]) > 0
    assert (tmp_path / "paper_values.html").read_text().count("<td><b>") == 39
    assert main(["paper", "values", str(tmp_path / "none")]) == 2
    assert "no such folder: run glsim paper reproduce" in capsys.readouterr().err
    write_table(tmp_path / "a" / "protocol_paper" / "table.csv", {**PRINTED_MSE})
    assert judged(tmp_path / "a")["Median", "mse_mm2"] == "too few seeds"


def test_another_table_is_refused(tmp_path: Path) -> None:
    path = write_filters(tmp_path, "dense", 1, "paper", PRINTED_MSE)
    path.write_text(path.read_text().replace("mean", "middle"))
    with pytest.raises(DatasetError, match=r"table\.csv: is no table of glsim eval"):
        write_values(tmp_path)
