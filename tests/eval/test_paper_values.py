"""The 39 printed values beside ours: one rule, the four cases, and a page that says it."""

import sys
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.core.errors import DatasetError
from glsim.eval.metrics.scored_map import psnr_db
from glsim.eval.paper.ours_beside_printed import printed_values, read_cases, verdict, write_values
from glsim.eval.paper.paper_tables import PAPER_ROWS
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from tests.support import checkpoint_stand_in
from tests.support.paper_scores import write_filters, write_networks, write_table

PRINTED_MSE = {name: row.mse_mm2 for name, row in PRINTED_FILTERS.items()}


@pytest.fixture(autouse=True)
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)


def judged(folder: Path) -> dict[tuple[str, str], str]:
    cases = read_cases(folder)
    return {
        (row.title, metric): verdict(row.title, metric, value, cases)
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
    assert set(judged(tmp_path).values()) == {"not comparable"}
    far = {name: value / 4 for name, value in PRINTED_MSE.items()}
    worse = far | {"bilateral": far["noisy"] * 1.2, "nlm": PRINTED_MSE["nlm"] * 0.9}
    write_filters(tmp_path, "dense", 1, "paper", worse)
    again = {name: value * 1.01 for name, value in worse.items()}
    write_filters(tmp_path, "dense", 2, "paper", again | {"nlm": PRINTED_MSE["nlm"] * 1.1})
    found = judged(tmp_path)
    assert found["NLM", "mse_mm2"] == "inside the seeds' spread"
    assert found["Median", "mse_mm2"] == found["Adaptive", "mse_mm2"] == "same order"
    assert found["Bilateral", "mse_mm2"] == "other order"
    assert found["Baseline", "mse_mm2"] == found["Restormer", "mse_mm2"] == "not comparable"
    # One case in which the order holds is enough; seeds that disagree have none.
    write_filters(tmp_path, "as-noisy", 1, "depth", far)
    assert judged(tmp_path)["Bilateral", "mse_mm2"] == "same order"
    write_filters(tmp_path, "as-noisy", 2, "depth", far | {"bilateral": far["noisy"] * 2})
    assert judged(tmp_path)["Bilateral", "mse_mm2"] == "other order"


def test_the_page_has_every_value_in_every_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed, factor in ((1, 0.9), (2, 1.1)):
        mse = {name: value * factor for name, value in PRINTED_MSE.items()}
        write_filters(tmp_path, "dense", seed, "paper", mse)
    write_table(tmp_path / "filters/dense/1/paper/baselines.csv", {"zero image": 2650.0})
    write_networks(tmp_path, "dense", "depth", 1000.0, {"D7": 700.0, "UNet": 1500.0}, "small")
    write_networks(tmp_path, "as-noisy", "paper", 100.0, {"D7": 130.0}, "full")
    assert main(["paper", "values", str(tmp_path)]) == 0
    page = (tmp_path / "paper_values.md").read_text()
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    rows = {tuple(cells[1:3]): cells for cells in lines if len(cells) == 9}
    assert len([1 for cells in rows.values() if cells[0] in "123"]) == 39
    spread = 0.2 * PRINTED_MSE["median"] / 2**0.5
    assert rows["Median", "MSE"][3:] == [
        *("1361", "-", "-", f"1361 ± {spread:.0f}" if spread >= 1000 else f"1361 ± {spread:.1f}"),
        *("-", "**inside the seeds' spread**"),
    ]
    assert rows["UNet (small)", "MSE"][4:] == ["1500", "-", "-", "-", "**same order**"]
    for row, printed in (("D7", "36238"), ("AR D7", "33702")):  # the same network
        cells = rows[f"{row} (full, small)", "MSE"]
        assert cells[3:] == [printed, "700.0", "-", "-", "130.0", "**same order**"]
    assert rows["zero image", "MSE"][6] == "2650"
    assert (tmp_path / "paper_values.html").read_text().count("<td><b>") == 39
    assert main(["paper", "values", str(tmp_path / "none")]) == 2
    assert "no such folder: run glsim paper reproduce" in capsys.readouterr().err


def test_another_table_is_refused(tmp_path: Path) -> None:
    path = write_filters(tmp_path, "dense", 1, "paper", PRINTED_MSE)
    path.write_text(path.read_text().replace("mean", "middle"))
    with pytest.raises(DatasetError, match=r"table\.csv: is no table of glsim eval"):
        write_values(tmp_path)
