"""Relations of the paper's tables 2 and 3, from rows that were trained with other seeds."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from glsim.eval.paper.findings import _mse_by_row, _network_relations, _ranges
from glsim.eval.paper.printed_values import PRINTED_FILTERS, PRINTED_NETWORKS
from glsim.eval.paper.runs import SeedGroup, TrainedRun


def run(folder: Path, row: str, seed: int) -> TrainedRun:
    return TrainedRun(folder / f"{row}-{seed}/best.pt", row, row, "small", "", seed, 1, 1, 1, True)


def write_table(folder: Path, mse: dict[str, float]) -> None:
    with (folder / "table.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "metric", "mean"])
        for method, value in mse.items():
            writer.writerows([[method, "mse_mm2", value], [method, "psnr_db", 1]])


def test_artefact_removal_is_compared_in_common_seeds(tmp_path: Path) -> None:
    """Its one seed is the worst of its partner's: that is no difference between the two."""
    write_table(tmp_path, {"noisy": 50, "D7-0": 30, "D7-1": 20, "D7-2": 10, "AR D7-0": 31})
    groups = [
        SeedGroup([run(tmp_path, "D7", seed) for seed in range(3)]),
        SeedGroup([run(tmp_path, "AR D7", 0)]),
    ]
    assert _mse_by_row(tmp_path, groups) == {"Baseline": 50, "D7": 20, "AR D7": 21}


def test_the_printed_values_have_the_printed_relations() -> None:
    printed = {row.title: row.mse_mm2 for row in PRINTED_FILTERS.values()}
    printed |= {row: values.mse_mm2 for row, values in PRINTED_NETWORKS.items()}
    table = _network_relations({"paper": printed})
    assert [row[1:] for row in table.rows] == [["yes", "yes"]] * len(table.rows)
    (said,) = _ranges({"paper": printed})
    assert "23.89 to 56.72 times" in said
    assert "23.9 to 56.7 times" in said


@pytest.mark.parametrize("row", ["Restormer", "D64", "Median"])
def test_a_row_without_scores_is_named(row: str) -> None:
    values = {r.title: r.mse_mm2 for r in (*PRINTED_FILTERS.values(), *PRINTED_NETWORKS.values())}
    del values[row]
    table = _network_relations({"depth": values})
    assert f"not scored: {row} not trained" in {cells[2] for cells in table.rows}
