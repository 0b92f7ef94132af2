"""Verdicts on the printed values: each rule, and a page that says what the scores say."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.errors import DatasetError
from glsim.eval.paper.cases import read_cases
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from glsim.eval.paper.verdict_page import VERDICT_FILES, write_verdicts
from glsim.eval.paper.verdicts import Verdict, verdicts
from tests.support import checkpoint_stand_in
from tests.support.paper_scores import write_networks, write_scores, write_table


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)


PRINTED_MSE = {name: row.mse_mm2 for name, row in PRINTED_FILTERS.items()}


def judged(folder: Path) -> dict[tuple[str, str], Verdict]:
    return {(one.row, one.metric): one for one in verdicts(read_cases(folder))}


def write_filters(folder: Path, seeds: dict[int, dict[str, float]]) -> None:
    for seed, mse in seeds.items():
        write_scores(folder, "dense", seed, "paper", mse)


def test_there_is_a_verdict_on_each_of_the_39_values(tmp_path: Path) -> None:
    found = verdicts(read_cases(tmp_path))
    assert [sum(one.table == table for one in found) for table in (1, 2, 3)] == [15, 6, 18]
    printed = {one.printed for one in found}
    for row in (*PRINTED_FILTERS.values(), *PRINTED_NETWORKS.values()):
        assert {row.mse_mm2, row.psnr_db, row.ssim} <= printed
    assert {one.name for one in found} == {"not trained yet"}


def test_within_the_spread_of_the_seeds_it_is_reproduced(tmp_path: Path) -> None:
    """Seeds of 0.9 and 1.1 times the printed value have a mean at it; of 2 and 2.2, far from it."""
    write_filters(
        tmp_path,
        {
            seed: {name: value * factor for name, value in PRINTED_MSE.items()}
            for seed, factor in ((1, 0.9), (2, 1.1))
        },
    )
    found = judged(tmp_path)
    median = found["Median", "MSE"]
    assert median.name == "reproduced"
    assert median.ours == pytest.approx(PRINTED_MSE["median"])
    assert median.spread == pytest.approx(PRINTED_MSE["median"] * 0.2 / 2**0.5)
    assert found["Restormer", "MSE"].name == "not trained yet"


def test_direction_refuted_and_not_comparable(tmp_path: Path) -> None:
    far = {name: value / 4 for name, value in PRINTED_MSE.items()}
    worse = far | {"bilateral": far["noisy"] * 1.2}
    write_filters(tmp_path, {1: worse, 2: {n: v * 1.01 for n, v in worse.items()}})
    found = judged(tmp_path)
    assert found["Median", "MSE"].name == "direction reproduced"
    assert "below the noisy input, as printed, in 1 of 1" in found["Median", "MSE"].reason
    assert found["Bilateral", "MSE"].name == "refuted"
    assert found["Baseline", "MSE"].name == "not comparable"
    assert found["Adaptive", "MSE"].name == "direction reproduced"
    assert "equal to the noisy input" in found["Adaptive", "MSE"].reason
    # Printed SSIMs of NLM and Bilateral are 0.16 and 0.23 below Baseline: no reading for all rows.
    assert found["Bilateral", "SSIM"].name == "not comparable"
    assert "another reading" in found["Bilateral", "SSIM"].reason
    # The one case where the direction holds is enough, and is named.
    write_scores(tmp_path, "as-noisy", 1, "depth", far)
    again = judged(tmp_path)["Bilateral", "MSE"]
    assert again.name == "direction reproduced"
    assert "1 of 2 scored cases (protocol depth, BlenSor's mask)" in again.reason


def test_seeds_that_disagree_have_no_direction(tmp_path: Path) -> None:
    far = {name: value / 4 for name, value in PRINTED_MSE.items()}
    write_filters(tmp_path, {1: far, 2: far | {"nlm": far["noisy"] * 2}})
    assert judged(tmp_path)["NLM", "MSE"].name == "refuted"


def test_small_networks_refute_nothing_and_twins_are_their_partners(tmp_path: Path) -> None:
    write_networks(tmp_path, "dense", "depth", 1000.0, {"D7": 700.0, "UNet": 1500.0})
    write_networks(tmp_path, "as-noisy", "paper", 100.0, {"D20": 90.0}, size="full")
    found = judged(tmp_path)
    assert found["D7", "MSE"].name == "not comparable"
    assert "trained smaller than published (10 steps" in found["D7", "MSE"].reason
    assert found["AR D7", "MSE"].ours == found["D7", "MSE"].ours == 700.0
    assert found["UNet", "MSE"].ours == 1500.0
    direction = found["UNet", "MSE"]
    assert direction.name == "direction reproduced"
    assert direction.spread is None
    assert "trained smaller than published (10 steps" in direction.reason
    assert found["D20", "MSE"].name == found["AR D20", "MSE"].name == "refuted"
    assert found["D20", "MSE"].case is not None
    assert found["D20", "MSE"].case.title == "protocol paper, BlenSor's mask"
    assert found["D64", "MSE"].name == "not trained yet"


def test_the_nearest_case_is_taken(tmp_path: Path) -> None:
    for mask, protocol, mse in (("dense", "depth", 20_000), ("as-noisy", "paper", 30_000)):
        write_networks(tmp_path, mask, protocol, 5000.0, {"D64": float(mse)})
    nearest = judged(tmp_path)["D64", "MSE"]
    assert (nearest.ours, nearest.name) == (30_000, "direction reproduced")
    assert "2 of 2 scored cases" in nearest.reason


def table_cells(page: str) -> dict[str, list[str]]:
    """Value -> cells of its row in the Markdown."""
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    return {cells[0]: cells[1:] for cells in lines if len(cells) == 4 and cells[0] != "value"}


def test_the_page_says_what_the_scores_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every row equals its verdict; another score is another page, after the command alone."""
    far = {name: value / 4 for name, value in PRINTED_MSE.items()}
    write_filters(tmp_path, {1: far, 2: {n: v * 1.02 for n, v in far.items()}})
    write_table(tmp_path / "filters/dense/1/paper/baselines.csv", {"zero image": 2650.0}, "paper")
    write_networks(tmp_path, "dense", "paper", 1000.0, {"D7": 700.0})
    assert main(["paper", "page", str(tmp_path)]) == 0
    page = (tmp_path / VERDICT_FILES[0]).read_text()
    cells = table_cells(page)
    found = judged(tmp_path)
    assert len(found) == 39
    for (row, metric), one in found.items():
        verdict, printed, ours = cells[f"{row}, {metric}"]
        assert verdict == f"**{one.name}**"
        digits = {"MSE": 4, "PSNR": 3, "SSIM": 4}[metric]
        assert float(printed) == pytest.approx(one.printed, rel=10.0**-digits * 5)
        if one.ours is None:
            assert ours == "-"
            case = ""
        else:
            assert float(ours.split(" ± ")[0]) == pytest.approx(one.ours, rel=2e-3, abs=6e-5)
            assert one.case is not None
            case = f" (nearest: {one.case.title})"
        line = f"- **{row}, {metric}**: {one.name}{case}. {one.reason} To decide: {one.decides} `"
        assert line in page
    counts = {m[1]: int(m[2]) for m in re.finditer(r"^\| ([a-z ]+) \| (\d+) \| ", page, re.M)}
    assert sum(counts.values()) == 39
    assert counts["not trained yet"] == 39 - 15 - 3 - 3
    assert "| protocol paper, dense clean maps |" in page
    assert "| 12.72 to 30.20 |" in page  # 33,702 and 80,018 over 2,650
    html = (tmp_path / VERDICT_FILES[1]).read_text()
    assert html.count("<td><b>") == 39
    capsys.readouterr()

    write_networks(tmp_path / "again", "dense", "paper", 1000.0, {"D7": 1700.0})
    (tmp_path / "again/protocol_paper/table.csv").replace(tmp_path / "protocol_paper/table.csv")
    write_verdicts(tmp_path)
    changed = table_cells((tmp_path / VERDICT_FILES[0]).read_text())
    assert cells["D7, MSE"][0] == "**not comparable**"
    assert changed["D7, MSE"][::2] == ["**direction reproduced**", "1700"]
    assert changed["Median, MSE"] == cells["Median, MSE"]


def test_folders_without_scores(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "page", str(tmp_path / "none")]) == 2
    assert "no such folder: run glsim paper reproduce" in capsys.readouterr().err
    path = write_scores(tmp_path, "dense", 1, "paper", PRINTED_MSE)
    path.write_text(path.read_text().replace("mean", "middle"))
    with pytest.raises(DatasetError, match=r"table\.csv: is no table of glsim eval"):
        write_verdicts(tmp_path)
